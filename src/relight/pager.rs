//! What stays in memory when not everything fits: decisions only, no bytes and no input or output.
//!
//! The same decisions serve stored chunks and blocks in the memory of the host, and banks of blocks in that of the GPU. A
//! page has one of two [`Detail`]s. Pages of the current view stay: a picture needs each of them once, so that exchanging
//! one for another would only read more. What the view has left goes first, the least recently used before the others. A
//! page that does not fit is used and not kept.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::hash::Hash;

/// How many layers of a page are present.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Detail {
    /// Its base layer.
    Base,
    /// All its layers, or all of them that can be read.
    Whole,
}

/// What to read, in this order: base layers of what is in view, then the rest of it, then base layers and the rest of what
/// is nearby. `at_hand` says what is there already.
pub fn plan<K: Copy>(view: &[K], nearby: &[K], at_hand: impl Fn(K) -> Option<Detail>) -> Vec<(K, Detail)> {
    let steps = [(view, Detail::Base), (view, Detail::Whole), (nearby, Detail::Base), (nearby, Detail::Whole)];
    let lacks = |key, wanted| at_hand(key).is_none_or(|detail| detail < wanted);
    let missing = |(keys, wanted): (&[K], Detail)| {
        keys.iter().filter(|key| lacks(**key, wanted)).map(|key| (*key, wanted)).collect::<Vec<_>>()
    };
    steps.into_iter().flat_map(missing).collect()
}

/// What happened to a page that was offered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Admission<K> {
    /// Whether it is kept.
    pub kept: bool,
    /// Pages that had to go, the least recently used first.
    pub evicted: Vec<K>,
}

/// The pages within a budget of bytes.
#[derive(Clone, Debug)]
pub struct Pager<K> {
    budget_bytes: u64,
    used_bytes: u64,
    /// Counts uses; no two pages share one.
    clock: u64,
    pages: HashMap<K, Page>,
    /// Pages out of view and in view, each by its last use: what may go is found without a look at what may not.
    unseen: BTreeMap<u64, K>,
    seen: BTreeMap<u64, K>,
    view: HashSet<K>,
}

#[derive(Clone, Copy, Debug)]
struct Page {
    detail: Detail,
    bytes: u64,
    last_use: u64,
}

impl<K: Copy + Eq + Hash> Pager<K> {
    /// No pages yet.
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            budget_bytes,
            used_bytes: 0,
            clock: 0,
            pages: HashMap::new(),
            unseen: BTreeMap::new(),
            seen: BTreeMap::new(),
            view: HashSet::new(),
        }
    }

    /// Says which pages are seen from now on: these are not evicted.
    pub fn set_view(&mut self, pages: impl IntoIterator<Item = K>) {
        let before = std::mem::replace(&mut self.view, pages.into_iter().collect());
        let left: Vec<K> = before.difference(&self.view).copied().collect();
        let come: Vec<K> = self.view.difference(&before).copied().collect();
        left.into_iter().chain(come).for_each(|key| self.regroup(key));
    }

    /// Says that a page is seen too.
    pub fn see(&mut self, key: K) {
        self.view.insert(key);
        self.regroup(key);
    }

    /// Puts a page that came into view, or left it, among those that are seen or not.
    fn regroup(&mut self, key: K) {
        if let Some(page) = self.pages.get(&key) {
            self.unseen.remove(&page.last_use);
            self.seen.remove(&page.last_use);
            let last_use = page.last_use;
            self.group_of(key).insert(last_use, key);
        }
    }

    /// Where a page of this key stands by its last use.
    fn group_of(&mut self, key: K) -> &mut BTreeMap<u64, K> {
        if self.view.contains(&key) { &mut self.seen } else { &mut self.unseen }
    }

    /// Uses a page: what is there of it.
    pub fn touch(&mut self, key: K) -> Option<Detail> {
        let page = self.pages.get_mut(&key)?;
        self.clock += 1;
        let last_use = std::mem::replace(&mut page.last_use, self.clock);
        let (detail, now) = (page.detail, self.clock);
        let group = self.group_of(key);
        group.remove(&last_use);
        group.insert(now, key);
        Some(detail)
    }

    /// The detail of a page that is present. Does not count as a use.
    pub fn detail(&self, key: K) -> Option<Detail> {
        self.pages.get(&key).map(|page| page.detail)
    }

    /// Offers a page that was read: whether it stays, and what goes for it. A page that is there in as much detail
    /// stays as it is; a base layer that cannot grow stays too.
    pub fn admit(&mut self, key: K, detail: Detail, bytes: u64) -> Admission<K> {
        let old = self.touch(key);
        if old.is_some_and(|old| old >= detail) {
            return Admission { kept: true, evicted: Vec::new() };
        }
        let old_bytes = self.pages.get(&key).map_or(0, |page| page.bytes);
        let others = self.used_bytes - old_bytes;
        let Some(allowed) = self.budget_bytes.checked_sub(bytes) else {
            return Admission { kept: false, evicted: Vec::new() };
        };
        let mut evicted = Vec::new();
        let mut freed = 0;
        for other in self.unseen.values().filter(|other| **other != key) {
            if others - freed <= allowed {
                break;
            }
            freed += self.pages[other].bytes;
            evicted.push(*other);
        }
        if others - freed > allowed {
            return Admission { kept: false, evicted: Vec::new() };
        }
        evicted.iter().for_each(|other| self.remove(*other));
        self.remove(key);
        self.clock += 1;
        let last_use = self.clock;
        self.pages.insert(key, Page { detail, bytes, last_use });
        self.group_of(key).insert(last_use, key);
        self.used_bytes += bytes;
        Admission { kept: true, evicted }
    }

    /// Evicts until at most `bytes` are used: room for what passes through. What is out of view goes first, and of that
    /// and the rest what was used least recently. Gives what went.
    pub fn shrink_to(&mut self, bytes: u64) -> Vec<K> {
        let mut evicted = Vec::new();
        while self.used_bytes > bytes {
            let Some((_, &key)) = self.unseen.first_key_value().or_else(|| self.seen.first_key_value()) else { break };
            self.remove(key);
            evicted.push(key);
        }
        evicted
    }

    /// Takes out a page that is of no more use.
    pub fn remove(&mut self, key: K) {
        if let Some(page) = self.pages.remove(&key) {
            self.group_of(key).remove(&page.last_use);
            self.used_bytes -= page.bytes;
        }
    }

    /// Bytes of all pages that are there; never above the budget.
    pub fn used_bytes(&self) -> u64 {
        self.used_bytes
    }

    /// The budget.
    pub fn budget_bytes(&self) -> u64 {
        self.budget_bytes
    }

    /// Number of pages that are there.
    pub fn len(&self) -> usize {
        self.pages.len()
    }

    /// Whether there are no pages.
    pub fn is_empty(&self) -> bool {
        self.pages.is_empty()
    }
}
