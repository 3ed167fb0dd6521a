//! The threads that plan and trace pictures. Each takes another task when it has finished one.

use std::cell::Cell;
use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use rayon::{ThreadBuilder, ThreadPool, ThreadPoolBuilder, Yield};

use crate::kernels::StandardFloats;
use crate::kernels::sys::{cores, new_thread};

/// How long an idle thread stays awake before it sleeps: waking up takes up to 0.7 ms, which is the
/// time of a whole picture.
const LINGER: Duration = Duration::from_millis(2);

/// The number of threads that a team may have, more than the cores of most machines. Four times as
/// many would search each other's queues for minutes.
pub const MAX_THREADS: usize = 1024;

/// The calling thread and others that help it.
pub struct Team {
    /// The other threads, if there are any. The thread that created the team is in this pool too,
    /// unless it belongs to another one.
    pool: Option<ThreadPool>,
    others: usize,
}

/// The team that was made last, and the number of threads that was requested for it.
static LAST: Mutex<Option<(usize, Arc<Team>)>> = Mutex::new(None);

impl Team {
    /// A team of the calling thread alone.
    pub const fn alone() -> Self {
        Team { pool: None, others: 0 }
    }

    /// A team of at most `threads` threads and at least 1: fewer if the system allows no more. If
    /// the last request was for the same number, the same team is returned, so that planning and
    /// tracing share their threads.
    pub fn up_to(threads: usize) -> Arc<Self> {
        if threads <= 1 {
            return Arc::new(Team::alone());
        }
        let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, team)) = last.as_ref().filter(|(asked, team)| [*asked, team.threads()].contains(&threads)) {
            return Arc::clone(team);
        }
        let team = Arc::new(Team::start(threads - 1));
        *last = Some((threads, Arc::clone(&team)));
        team.keep_awake();
        team
    }

    /// A team of exactly `threads` threads.
    ///
    /// # Errors
    /// The number of threads that there can be, if the system allows fewer.
    pub fn of(threads: usize) -> Result<Arc<Self>, usize> {
        if threads > MAX_THREADS {
            return Err(MAX_THREADS);
        }
        let team = Team::up_to(threads);
        if team.threads() >= threads {
            return Ok(team);
        }
        // The system may allow more threads the next time.
        *LAST.lock().unwrap_or_else(PoisonError::into_inner) = None;
        Err(team.threads())
    }

    /// Starts up to `others` other threads, and then makes a pool of those that have started:
    /// making a pool fails if one of its threads cannot be started.
    fn start(others: usize) -> Self {
        let started = (0..others).map_while(|_| {
            let (give, take) = mpsc::channel::<ThreadBuilder>();
            let thread = new_thread().and_then(|thread| thread.spawn(move || take.recv().map(run_in_pool)));
            thread.is_ok().then_some(give)
        });
        let mut started: Vec<_> = started.collect();
        let others = started.len();
        let mut pool = |threads: usize, with_this: bool| {
            let hand_over =
                |thread| started.pop().and_then(|give| give.send(thread).ok()).ok_or(io::ErrorKind::Other.into());
            let builder = ThreadPoolBuilder::new().num_threads(threads).spawn_handler(hand_over);
            if with_this { builder.use_current_thread().build() } else { builder.build() }.ok()
        };
        let pool = (others > 0).then(|| pool(1 + others, true).or_else(|| pool(others, false))).flatten();
        Team { others: if pool.is_some() { others } else { 0 }, pool }
    }

    pub fn threads(&self) -> usize {
        1 + self.others
    }

    /// Lets all threads take tasks until none is left. The calling thread takes part, from the
    /// front: it need neither wait until another thread is awake, nor at the end for one that has
    /// not begun because other programs use its core. The other threads take tasks from the back,
    /// so that two threads find in their caches what they wrote the last time.
    pub fn share<T: Send>(&self, tasks: impl Iterator<Item = T>, work: impl Fn(T) + Sync) {
        self.share_with(tasks, Halved::whole, || (), |(), task| work(task));
    }

    /// As [`share`](Self::share), but a thread that takes the last task divides it by `halve`,
    /// takes one half and leaves the other, so that all threads finish at about the same time. Each
    /// thread that takes tasks makes a state by `begin`, which its tasks share. Returns these
    /// states.
    pub fn share_with<T: Send, S: Send>(
        &self,
        tasks: impl Iterator<Item = T>,
        halve: impl Fn(T) -> Halved<T> + Sync,
        begin: impl Fn() -> S + Sync,
        work: impl Fn(&mut S, T) + Sync,
    ) -> Vec<S> {
        let mut own = None;
        let mut work_here = |task| work(own.get_or_insert_with(&begin), task);
        let Some(pool) = &self.pool else {
            tasks.for_each(work_here);
            return own.into_iter().collect();
        };
        let queue = Queue { tasks: Mutex::new(tasks.collect()), halve };
        let done = AtomicUsize::new(0);
        let of_others = Mutex::new(Vec::new());
        let work_there = || {
            let mut theirs = None;
            while let Some(task) = queue.take(VecDeque::pop_back) {
                work(theirs.get_or_insert_with(&begin), task);
            }
            of_others.lock().unwrap_or_else(PoisonError::into_inner).extend(theirs);
            done.fetch_add(1, Ordering::Release);
        };
        pool.in_place_scope(|scope| {
            for _ in 0..self.others {
                scope.spawn(|_| work_there());
            }
            while let Some(task) = queue.take(VecDeque::pop_front) {
                work_here(task);
            }
            // Nothing is left for threads that have not begun. If the calling thread belongs to the
            // pool, it runs their jobs, which end at once.
            while rayon::yield_local() == Some(Yield::Executed) {}
            wait_a_while(|| done.load(Ordering::Acquire) == self.others);
        });
        own.into_iter().chain(of_others.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
    }

    /// Keeps the other threads awake for a while when they become idle; see `linger`.
    pub fn keep_awake(&self) {
        let Some(pool) = &self.pool else { return };
        let here = thread::current().id();
        for _ in 0..self.others {
            pool.spawn(move || {
                // The calling thread may run this job itself while it waits for others. It has work
                // to do, and must not linger.
                if thread::current().id() != here {
                    linger();
                }
            });
        }
    }
}

/// Runs a thread of a pool with the floating-point settings that Rust assumes: a library of the
/// host may change the settings of each new thread.
fn run_in_pool(thread: ThreadBuilder) {
    let _floats = StandardFloats::set();
    thread.run();
}

/// The results of `work` for each number below `count`, in order, computed with a thread per core.
/// The threads are started by the first call, and are kept. If they cannot be started, the calling
/// thread computes everything.
pub fn on_all_cores<R: Send>(count: usize, work: impl Fn(usize) -> R + Send + Sync) -> Vec<R> {
    static ALL: OnceLock<Option<ThreadPool>> = OnceLock::new();
    let start = |thread: ThreadBuilder| new_thread()?.spawn(|| run_in_pool(thread)).map(drop);
    match ALL.get_or_init(|| ThreadPoolBuilder::new().num_threads(cores()).spawn_handler(start).build().ok()) {
        Some(all) => all.install(|| (0..count).into_par_iter().map(work).collect()),
        None => (0..count).map(work).collect(),
    }
}

/// A task that may have been divided in two.
pub struct Halved<T> {
    pub first: T,
    pub rest: Option<T>,
}

impl<T> Halved<T> {
    /// A task that is not divided.
    pub fn whole(task: T) -> Self {
        Halved { first: task, rest: None }
    }
}

/// The tasks that no thread has taken yet.
struct Queue<T, H> {
    tasks: Mutex<VecDeque<T>>,
    halve: H,
}

impl<T, H: Fn(T) -> Halved<T>> Queue<T, H> {
    /// Takes the task at one end; only half of it if it is the last one.
    fn take(&self, pop: fn(&mut VecDeque<T>) -> Option<T>) -> Option<T> {
        let mut tasks = self.tasks.lock().unwrap_or_else(PoisonError::into_inner);
        let task = pop(&mut tasks)?;
        if !tasks.is_empty() {
            return Some(task);
        }
        let Halved { first, rest } = (self.halve)(task);
        tasks.extend(rest);
        Some(first)
    }
}

/// Keeps a thread of a pool awake, looking for work, until it has found none for [`LINGER`].
fn linger() {
    thread_local!(static LINGERS: Cell<bool> = const { Cell::new(false) });
    // The work that a lingering thread finds may be another such job.
    if LINGERS.replace(true) {
        return;
    }
    while wait_a_while(|| rayon::yield_now() == Some(Yield::Executed)) {}
    LINGERS.set(false);
}

/// Waits, without sleeping, until `is_so` holds, but not much longer than [`LINGER`]. Returns
/// whether it holds.
fn wait_a_while(is_so: impl Fn() -> bool) -> bool {
    let start = Instant::now();
    loop {
        if is_so() {
            return true;
        }
        if start.elapsed() > LINGER {
            return false;
        }
        thread::yield_now();
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::*;

    #[test]
    fn every_task_is_done_once_and_what_threads_keep_adds_up() {
        for threads in [1, 2, 5] {
            let team = Team::of(threads).unwrap();
            assert_eq!(team.threads(), threads);
            for count in [0, 1, 2, 1000] {
                let tasks = (0..count).step_by(10).map(|start| start..count.min(start + 10));
                let halve = |task: Range<usize>| match task.start + task.len() / 2 {
                    middle if middle > task.start => Halved { first: task.start..middle, rest: Some(middle..task.end) },
                    _ => Halved::whole(task),
                };
                let work = |kept: &mut Vec<_>, task: Range<usize>| kept.extend(task);
                let kept = team.share_with(tasks, halve, Vec::new, work);
                assert!(kept.len() <= threads && kept.iter().all(|kept| !kept.is_empty()), "{kept:?}");
                let mut all = kept.concat();
                all.sort_unstable();
                assert!(all.into_iter().eq(0..count), "{threads} threads, {count} pieces of work");
            }
        }
    }

    #[test]
    fn too_many_threads_are_refused_before_one_starts() {
        assert_eq!(Team::of(1 << 40).err(), Some(MAX_THREADS));
    }

    #[test]
    fn who_asks_for_as_many_threads_again_gets_the_same() {
        // Other tests may request teams at the same time.
        let same = || Arc::ptr_eq(&Team::of(3).unwrap(), &Team::of(3).unwrap());
        assert!((0..100).any(|_| same()));
    }
}
