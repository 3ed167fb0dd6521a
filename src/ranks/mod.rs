//! Ranks: the processes that MPI started together, and tasks that each takes as it becomes free.
//!
//! Rank 0 hands out the tasks and takes their results in order. A rank keeps a result until rank 0 asks for it, so that
//! rank 0 holds few at a time with any number of ranks; and a rank that holds many takes no further task. (A shared
//! counter, read by the ranks themselves, would need MPI's one-sided operations, which the crate `mpi` lacks.)

use std::collections::{BTreeMap, VecDeque};
use std::sync::Mutex;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use mpi::Threading;
use mpi::environment::Universe;
use mpi::point_to_point::{Message, Status};
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;

use crate::kernels::sys::new_thread;

/// How far ranks may be ahead of rank 0.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// Tasks of a rank that have no result yet.
    ahead: usize,
    /// Results that a rank holds.
    held: usize,
    /// Results that rank 0 has requested from others.
    asked_for: u64,
}

impl Pace {
    /// For short tasks with large results: the next one is there before it is needed.
    pub const BANDS: Pace = Pace { ahead: 2, held: 8, asked_for: 16 };
    /// For long tasks with small results: none waits for a rank while another is free.
    pub const CELLS: Pace = Pace { ahead: 1, held: usize::MAX, asked_for: u64::MAX };
}

/// How long a rank without messages sleeps, from the first time to the last: MPI's own waiting would keep a core busy
/// that has rays to trace.
const NAPS: [Duration; 2] = [Duration::from_micros(50), Duration::from_millis(2)];

/// The kinds of messages.
mod tag {
    use mpi::Tag;

    /// To rank 0: request for a task.
    pub const ASK: Tag = 1;
    /// From rank 0: the number of a task.
    pub const TASK: Tag = 2;
    /// From rank 0: request for the result of a task.
    pub const GIVE: Tag = 3;
    /// To rank 0: a result or an error, which of them, and the task's number.
    pub const RESULT: Tag = 4;
    /// From rank 0: there are no more tasks. Also the last message to rank 0.
    pub const END: Tag = 5;
}

/// This process among those that MPI started.
pub struct Ranks {
    world: SimpleCommunicator,
    /// For messages about tasks, which are received from any rank.
    tasks: SimpleCommunicator,
    /// Ends MPI when it is dropped.
    _universe: Universe,
}

impl Drop for Ranks {
    fn drop(&mut self) {
        // The others would wait for this one for ever.
        if std::thread::panicking() {
            self.world.abort(1);
        }
    }
}

/// The next nap.
struct Naps(Duration);

impl Naps {
    fn new() -> Self {
        Naps(NAPS[0])
    }

    fn take(&mut self) {
        self.next(std::thread::sleep);
    }

    /// Calls `wait` with the nap's time as its limit.
    fn next<T>(&mut self, wait: impl FnOnce(Duration) -> T) -> T {
        let nap = self.0;
        self.0 = (2 * nap).min(NAPS[1]);
        wait(nap)
    }
}

impl Ranks {
    /// Joins the processes that MPI has started; None if there is only one, or if MPI did not start it.
    pub fn join() -> Option<Ranks> {
        // Alone, a program need not wait until MPI is ready. Open MPI's launcher and others set these.
        let started =
            ["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"].iter().any(|name| std::env::var_os(name).is_some());
        if !started {
            return None;
        }
        let (universe, _) = mpi::initialize_with_threading(Threading::Funneled)?;
        let world = universe.world();
        (world.size() > 1).then(|| Ranks { tasks: world.duplicate(), world, _universe: universe })
    }

    pub fn rank(&self) -> usize {
        self.world.rank() as usize
    }

    /// The number of ranks.
    pub fn count(&self) -> usize {
        self.world.size() as usize
    }

    /// The name of this rank's machine.
    pub fn host() -> String {
        mpi::environment::processor_name().unwrap_or_else(|_| "a host without a name".into())
    }

    fn talk(&self, to: usize, bytes: &[u8]) {
        self.world.process_at_rank(to as i32).send(bytes);
    }

    /// The next message of a rank, without keeping a core busy until it comes.
    fn listen(&self, from: usize) -> Vec<u8> {
        let process = self.world.process_at_rank(from as i32);
        let mut naps = Naps::new();
        loop {
            match process.immediate_matched_probe() {
                Some(message) => return message.matched_receive_vec().0,
                None => naps.take(),
            }
        }
    }

    /// The contributions of all ranks, in their order, on rank 0; nothing on the others.
    pub fn gather(&self, mine: Vec<u8>) -> Vec<Vec<u8>> {
        if self.rank() > 0 {
            self.talk(0, &mine);
            return Vec::new();
        }
        let others = (1..self.count()).map(|rank| self.listen(rank));
        [mine].into_iter().chain(others).collect()
    }

    /// Rank 0's contribution, on all ranks.
    pub fn broadcast(&self, mine: Vec<u8>) -> Vec<u8> {
        /// At most as much at once as an `int` counts.
        const MOST: usize = 1 << 30;
        let root = self.world.process_at_rank(0);
        let mut bytes = mine;
        if self.rank() == 0 {
            let length = (bytes.len() as u64).to_le_bytes();
            (1..self.count()).for_each(|rank| self.talk(rank, &length));
        } else {
            bytes = vec![0; number(&self.listen(0)) as usize];
        }
        bytes.chunks_mut(MOST).for_each(|part| root.broadcast_into(part));
        bytes
    }

    /// Has all ranks do the `tasks`: `work` makes the result of one, in a thread of its own if there can be one, and rank
    /// 0 hands them to `take` in order, with the error of a rank that failed. An error of `take` ends it.
    ///
    /// # Errors
    /// The error of `take`, on rank 0.
    pub fn share<E>(
        &self,
        (tasks, pace): (u64, Pace),
        work: impl FnMut(u64) -> Result<Vec<u8>, String> + Send,
        mut take: impl FnMut(u64, Result<Vec<u8>, String>) -> Result<(), E>,
    ) -> Result<(), E> {
        let work = Mutex::new(work);
        let done = &|task| (task, work.lock().expect("whoever panicked here has ended all")(task));
        std::thread::scope(|scope| {
            let (begin, begun) = channel();
            let (end, ended) = channel();
            let own_end = end.clone();
            let worker = move || {
                for task in begun {
                    // The channel is closed if something else has failed.
                    if end.send(done(task)).is_err() {
                        return;
                    }
                }
            };
            let started = new_thread().and_then(|thread| thread.spawn_scoped(scope, worker));
            let without_thread = started.is_err().then_some(own_end);
            let mut own = Own { pace, held: VecDeque::new(), working: 0 };
            let own_results = |wait| match ended.recv_timeout(wait) {
                Ok(result) => Some(result),
                Err(RecvTimeoutError::Timeout) => None,
                // It has panicked, and reported that.
                Err(RecvTimeoutError::Disconnected) => self.world.abort(1),
            };
            let begin = |task| match &without_thread {
                Some(end) => _ = end.send(done(task)),
                None => _ = begin.send(task),
            };
            let result = if self.rank() == 0 {
                self.hand_out(tasks, &mut own, begin, own_results, &mut take)
            } else {
                self.serve(&mut own, begin, own_results);
                Ok(())
            };
            // No message about later tasks is sent before all are here.
            self.broadcast(Vec::new());
            result
        })
    }

    /// Rank 0: hands out tasks, this rank's too, and takes the results.
    fn hand_out<E>(
        &self,
        tasks: u64,
        own: &mut Own,
        begin: impl Fn(u64),
        own_results: impl Fn(Duration) -> Option<(u64, Outcome)>,
        take: &mut impl FnMut(u64, Outcome) -> Result<(), E>,
    ) -> Result<(), E> {
        // The task to hand out next, the one whose result is next, and the one to request next.
        let (mut next, mut taken, mut asked) = (0, 0, 0);
        let mut owners = BTreeMap::new();
        let mut arrived: BTreeMap<u64, Outcome> = BTreeMap::new();
        let mut waiting = VecDeque::new();
        let mut naps = Naps::new();
        let mut result = Ok(());
        while taken < tasks && result.is_ok() {
            let mut idle = true;
            while let Some(of_own) = own_results(Duration::ZERO) {
                own.finished(of_own);
                idle = false;
            }
            while let Some((from, what, bytes)) = self.message() {
                match what {
                    tag::ASK => waiting.push_back(from),
                    _ => arrived.extend(outcome(bytes)),
                }
                idle = false;
            }
            // Others first: this rank's own tasks need no message.
            while next < tasks
                && let Some(rank) = waiting.pop_front()
            {
                self.send(rank, tag::TASK, &next.to_le_bytes());
                owners.insert(next, rank);
                next += 1;
            }
            while next < tasks && own.wants(0) {
                begin(next);
                own.working += 1;
                next += 1;
            }
            while asked < next && asked < own.pace.asked_for.saturating_add(taken) {
                if let Some(rank) = owners.remove(&asked) {
                    self.send(rank, tag::GIVE, &asked.to_le_bytes());
                }
                asked += 1;
            }
            while result.is_ok()
                && let Some(of_next) = arrived.remove(&taken).or_else(|| own.give(taken))
            {
                result = take(taken, of_next);
                taken += 1;
                idle = false;
            }
            if !idle {
                naps = Naps::new();
            } else if let Some(of_own) = naps.next(&own_results) {
                own.finished(of_own);
            }
        }
        // Requested results are on their way, and have to be received.
        let mut left = self.count() - 1;
        (1..=left).for_each(|rank| self.send(rank, tag::END, &[]));
        while left > 0 {
            match self.message() {
                Some((_, what, _)) => left -= usize::from(what == tag::END),
                None => naps.take(),
            }
        }
        result
    }

    /// The other ranks: work on tasks, and send their results on request.
    fn serve(&self, own: &mut Own, begin: impl Fn(u64), own_results: impl Fn(Duration) -> Option<(u64, Outcome)>) {
        let mut wanted: VecDeque<u64> = VecDeque::new();
        let mut asked = 0;
        let mut naps = Naps::new();
        loop {
            let mut idle = true;
            while let Some(of_own) = own_results(Duration::ZERO) {
                own.finished(of_own);
                idle = false;
            }
            // Tasks and requests for them come in order.
            while let Some(of_first) = wanted.front().and_then(|task| own.give(*task)) {
                let task = wanted.pop_front().unwrap_or_default();
                self.send_result(&message(task, of_first));
                idle = false;
            }
            while own.wants(asked) {
                self.send(0, tag::ASK, &[]);
                asked += 1;
            }
            while let Some((_, what, bytes)) = self.message() {
                match what {
                    tag::TASK => {
                        begin(number(&bytes));
                        own.working += 1;
                        asked -= 1;
                    }
                    tag::GIVE => wanted.push_back(number(&bytes)),
                    _ => return self.send(0, tag::END, &[]),
                }
                idle = false;
            }
            if !idle {
                naps = Naps::new();
            } else if let Some(of_own) = naps.next(&own_results) {
                own.finished(of_own);
            }
        }
    }

    fn send(&self, to: usize, tag: mpi::Tag, bytes: &[u8]) {
        self.tasks.process_at_rank(to as i32).send_with_tag(bytes, tag);
    }

    /// Sends rank 0 a result. MPI's own sending would keep a core busy until rank 0 receives it.
    fn send_result(&self, message: &[u8]) {
        mpi::request::scope(|scope| {
            let rank_0 = self.tasks.process_at_rank(0);
            let mut request = rank_0.immediate_send_with_tag(scope, message, tag::RESULT);
            let mut naps = Naps::new();
            while let Err(on_its_way) = request.test() {
                request = on_its_way;
                naps.take();
            }
        });
    }

    /// A message about tasks that has arrived: its rank, its kind, and its content.
    fn message(&self) -> Option<(usize, mpi::Tag, Vec<u8>)> {
        let message: (Message, Status) = self.tasks.any_process().immediate_matched_probe()?;
        let (from, what) = (message.1.source_rank() as usize, message.1.tag());
        Some((from, what, message.matched_receive_vec().0))
    }
}

type Outcome = Result<Vec<u8>, String>;

/// This rank's own tasks.
struct Own {
    pace: Pace,
    /// Results that have not been requested, in the order of the tasks.
    held: VecDeque<(u64, Outcome)>,
    /// Tasks that have no result yet.
    working: usize,
}

impl Own {
    /// Whether there is room for a task, with `asked` ones on their way.
    fn wants(&self, asked: usize) -> bool {
        let Pace { ahead, held, .. } = self.pace;
        let working = self.working + asked;
        working < ahead && working + self.held.len() < held
    }

    fn finished(&mut self, result: (u64, Outcome)) {
        self.working -= 1;
        self.held.push_back(result);
    }

    /// The result of a task, if it is the first here.
    fn give(&mut self, task: u64) -> Option<Outcome> {
        let is_first = self.held.front().is_some_and(|(first, _)| *first == task);
        is_first.then(|| self.held.pop_front())?.map(|(_, result)| result)
    }
}

fn number(bytes: &[u8]) -> u64 {
    bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

/// The task's number comes last, so that a large result stays where it is.
fn message(task: u64, result: Outcome) -> Vec<u8> {
    let (fine, mut bytes) = match result {
        Ok(bytes) => (1, bytes),
        Err(what) => (0, what.into_bytes()),
    };
    bytes.push(fine);
    bytes.extend(task.to_le_bytes());
    bytes
}

/// A task and its outcome, from their message.
fn outcome(mut message: Vec<u8>) -> Option<(u64, Outcome)> {
    let (rest, task) = message.split_last_chunk()?;
    let (task, length) = (u64::from_le_bytes(*task), rest.len());
    message.truncate(length);
    Some(match message.pop()? {
        1 => (task, Ok(message)),
        _ => (task, Err(String::from_utf8_lossy(&message).into_owned())),
    })
}
