//! The sizes of the data caches, if the system reports them.

use serde::{Deserialize, Serialize};

/// A data cache of one level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Cache {
    /// The level; 1 is the nearest to the core.
    pub level: u32,
    /// The cache's size.
    pub bytes: usize,
}

/// The data caches of the first core, as Linux reports them.
pub fn caches() -> Vec<Cache> {
    let read = |index: u32, name: &str| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{name}");
        Some(std::fs::read_to_string(path).ok()?.trim().to_owned())
    };
    let mut caches = Vec::new();
    for index in 0.. {
        let Some(kind) = read(index, "type") else { break };
        let size = read(index, "size").as_deref().and_then(cache_bytes);
        let level = read(index, "level").and_then(|level| level.parse().ok());
        if let (true, Some(level), Some(bytes)) = (kind != "Instruction", level, size) {
            caches.push(Cache { level, bytes });
        }
    }
    caches.sort_unstable_by_key(|cache| cache.level);
    caches
}

/// A size as Linux writes it: 32K, 1M.
fn cache_bytes(text: &str) -> Option<usize> {
    let digits = text.trim_end_matches(['K', 'M']);
    let unit = match &text[digits.len()..] {
        "" => 1,
        "K" => 1 << 10,
        "M" => 1 << 20,
        _ => return None,
    };
    digits.parse::<usize>().ok()?.checked_mul(unit)
}

#[cfg(test)]
mod tests {
    use super::cache_bytes;

    #[test]
    fn the_size_of_a_cache_is_read_as_linux_writes_it() {
        for (text, bytes) in
            [("32K", Some(32 << 10)), ("1M", Some(1 << 20)), ("512", Some(512)), ("", None), ("KK", None)]
        {
            assert_eq!(cache_bytes(text), bytes, "{text}");
        }
    }
}
