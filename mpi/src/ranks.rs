//! Ranks: the processes that MPI started together, their messages, and what they agree on.

use std::thread::sleep;
use std::time::Duration;

use mpi::Threading;
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;

use crate::Failure;

/// How long a rank that waits for a message sleeps between two looks: at first, and at most. MPI's
/// own waiting would keep a core busy that has rays to trace.
const SHORTEST_NAP: Duration = Duration::from_micros(50);
const LONGEST_NAP: Duration = Duration::from_millis(1);

/// This process among those that MPI started.
pub struct Ranks {
    world: SimpleCommunicator,
    /// Ends MPI when it is dropped.
    _universe: Universe,
}

/// The length of the next nap: each is twice as long as the one before.
pub struct Naps(Duration);

impl Naps {
    pub fn new() -> Self {
        Naps(SHORTEST_NAP)
    }

    pub fn take(&mut self) {
        sleep(self.0);
        self.0 = (2 * self.0).min(LONGEST_NAP);
    }
}

impl Ranks {
    /// Joins the processes that MPI has started, of which there may be only one. Only the thread
    /// that calls this may send and receive. None if MPI cannot be started.
    pub fn join() -> Option<Ranks> {
        let (universe, _) = mpi::initialize_with_threading(Threading::Funneled)?;
        Some(Ranks { world: universe.world(), _universe: universe })
    }

    pub fn rank(&self) -> usize {
        self.world.rank() as usize
    }

    /// The number of ranks.
    pub fn count(&self) -> usize {
        self.world.size() as usize
    }

    /// Ends all ranks at once.
    pub fn abort(&self, status: u8) -> ! {
        self.world.abort(status.into())
    }

    pub fn send(&self, to: usize, bytes: &[u8]) {
        self.world.process_at_rank(to as i32).send(bytes);
    }

    /// The next message of a rank, without keeping a core busy until it comes.
    pub fn receive(&self, from: usize) -> Vec<u8> {
        let process = self.world.process_at_rank(from as i32);
        let mut naps = Naps::new();
        loop {
            match process.immediate_matched_probe() {
                Some(message) => return message.matched_receive_vec().0,
                None => naps.take(),
            }
        }
    }

    /// A message that has arrived, and its rank.
    pub fn arrived(&self) -> Option<(usize, Vec<u8>)> {
        let (bytes, status) = self.world.any_process().immediate_matched_probe()?.matched_receive_vec();
        Some((status.source_rank() as usize, bytes))
    }

    /// The contributions of all ranks, in their order, on rank 0; nothing on the others.
    pub fn gather(&self, mine: Vec<u8>) -> Vec<Vec<u8>> {
        if self.rank() > 0 {
            self.send(0, &mine);
            return Vec::new();
        }
        let others = (1..self.count()).map(|rank| self.receive(rank));
        [mine].into_iter().chain(others).collect()
    }

    /// Rank 0's contribution, on all ranks.
    pub fn broadcast(&self, mine: Vec<u8>) -> Vec<u8> {
        if self.rank() > 0 {
            return self.receive(0);
        }
        (1..self.count()).for_each(|rank| self.send(rank, &mine));
        mine
    }

    /// The result of this rank if no rank has failed. Otherwise every rank gets the same failure:
    /// the one that all have, or the first one with its rank and host.
    pub fn agree<T>(&self, result: Result<T, Failure>) -> Result<T, Failure> {
        let host = mpi::environment::processor_name().unwrap_or_else(|_| "a host without a name".into());
        let word = match &result {
            Ok(_) => Vec::new(),
            Err(Failure { message, status }) => format!("{status}\0{message}\0{host}").into_bytes(),
        };
        let verdict = self.broadcast(verdict(&self.gather(word)));
        match (String::from_utf8_lossy(&verdict).split_once('\0'), result) {
            (None, result) => result,
            (Some((status, message)), _) => {
                Err(Failure { message: message.into(), status: status.parse().unwrap_or(1) })
            }
        }
    }

    /// Fails with `message` if these bytes differ from those of rank 0.
    pub fn same(&self, mine: &[u8], message: &str) -> Result<(), Failure> {
        let is_same = self.broadcast(mine.to_vec()) == mine;
        self.agree(if is_same { Ok(()) } else { Err(Failure::output(message)) })
    }
}

/// The failure that all ranks get, as its status and its message; empty where no rank has failed.
/// The word of a rank that has failed is its status, its message and its host, with zeros between
/// them.
fn verdict(words: &[Vec<u8>]) -> Vec<u8> {
    let failed = |word: &Vec<u8>| {
        let word = String::from_utf8_lossy(word).into_owned();
        let (status, rest) = word.split_once('\0')?;
        let (message, host) = rest.rsplit_once('\0')?;
        Some((status.to_owned(), message.to_owned(), host.to_owned()))
    };
    let failures: Vec<_> = (0..).zip(words).filter_map(|(rank, word)| Some((rank, failed(word)?))).collect();
    let Some((rank, (status, message, host))) = failures.first() else { return Vec::new() };
    let is_common = failures.len() == words.len() && failures.iter().all(|(_, (_, other, _))| other == message);
    // Rank 0 is where the user looks, and does alone what the others do not, such as writing: its
    // failures need no rank and no host.
    if is_common || *rank == 0 {
        return format!("{status}\0{message}").into_bytes();
    }
    let message = message.strip_prefix("error: ").unwrap_or(message);
    let others = match failures.len() - 1 {
        0 => String::new(),
        others => format!(" ({others} more of {} ranks failed too)", words.len()),
    };
    format!("1\0rank {rank} on {host}: {message}{others}").into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_failure_is_named_and_one_of_all_is_told_once() {
        let fine = Vec::new();
        let failed = |host: &str| format!("2\0there is no scene\0{host}").into_bytes();
        let text = |words: &[Vec<u8>]| String::from_utf8(verdict(words)).unwrap();
        assert_eq!(text(&[fine.clone(), fine.clone()]), "");
        assert_eq!(text(&[failed("a"), failed("b")]), "2\0there is no scene");
        assert_eq!(text(&[fine.clone(), failed("b"), fine.clone()]), "1\0rank 1 on b: there is no scene");
        assert_eq!(
            text(&[fine, failed("b"), failed("c")]),
            "1\0rank 1 on b: there is no scene (1 more of 3 ranks failed too)"
        );
    }
}
