//! What was loaded or formed last, kept in memory up to so many bytes.

use std::sync::{Arc, Mutex, PoisonError};

/// Values by key, the least recently used thrown out first; see the module.
pub struct Cache<T> {
    kept: Mutex<Vec<Kept<T>>>,
    /// Bytes kept at most.
    limit: usize,
}

struct Kept<T> {
    key: String,
    value: Arc<T>,
    bytes: usize,
}

impl<T> Cache<T> {
    pub fn new(limit: usize) -> Self {
        Self { kept: Mutex::default(), limit }
    }

    pub fn get(&self, key: &str) -> Option<Arc<T>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let at = kept.iter().position(|one| one.key == key)?;
        let hit = kept.remove(at);
        let value = hit.value.clone();
        kept.push(hit);
        Some(value)
    }

    /// Keeps a value of so many bytes, and throws out others for it. One larger than everything is not kept.
    pub fn keep(&self, key: &str, value: Arc<T>, bytes: usize) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|one| one.key != key);
        if bytes > self.limit {
            return;
        }
        let mut held: usize = kept.iter().map(|one| one.bytes).sum();
        while held + bytes > self.limit && !kept.is_empty() {
            held -= kept.remove(0).bytes;
        }
        kept.push(Kept { key: key.to_owned(), value, bytes });
    }

    /// Throws out what was deleted.
    pub fn forget(&self, key: &str) {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).retain(|one| one.key != key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_used_for_longest_goes_first_and_bytes_are_bounded() {
        let cache = Cache::new(100);
        ["a", "b", "c"].iter().for_each(|key| cache.keep(key, Arc::new(*key), 30));
        assert!(cache.get("a").is_some());
        cache.keep("d", Arc::new("d"), 40);
        assert!(cache.get("b").is_none() && cache.get("a").is_some() && cache.get("c").is_some());
        cache.keep("e", Arc::new("e"), 101);
        assert!(cache.get("e").is_none() && cache.get("d").is_some());
        cache.forget("d");
        assert!(cache.get("d").is_none());
    }
}
