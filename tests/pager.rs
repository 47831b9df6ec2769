//! What stays in memory: the pager does what a plain list of pages would, for any sequence of views, uses and reads.

use std::collections::HashSet;

use ltm::relight::{Admission, Detail, Pager, plan};
use proptest::prelude::*;

/// The same decisions from a list in the order of use, the least recently used first.
struct Model {
    budget_bytes: u64,
    pages: Vec<(u8, Detail, u64)>,
    view: HashSet<u8>,
}

impl Model {
    fn used_bytes(&self) -> u64 {
        self.pages.iter().map(|page| page.2).sum()
    }

    fn touch(&mut self, key: u8) -> Option<Detail> {
        let at = self.pages.iter().position(|page| page.0 == key)?;
        let page = self.pages.remove(at);
        self.pages.push(page);
        Some(page.1)
    }

    fn admit(&mut self, key: u8, detail: Detail, bytes: u64) -> Admission<u8> {
        if self.touch(key).is_some_and(|old| old >= detail) {
            return Admission { kept: true, evicted: vec![] };
        }
        // Tries evictions on a copy, one page after the other, until the new one fits.
        let mut rest: Vec<_> = self.pages.iter().copied().filter(|page| page.0 != key).collect();
        let mut evicted = Vec::new();
        loop {
            if rest.iter().map(|page| page.2).sum::<u64>() + bytes <= self.budget_bytes {
                rest.push((key, detail, bytes));
                self.pages = rest;
                return Admission { kept: true, evicted };
            }
            match rest.iter().position(|page| !self.view.contains(&page.0)) {
                Some(at) if bytes <= self.budget_bytes => evicted.push(rest.remove(at).0),
                _ => return Admission { kept: false, evicted: vec![] },
            }
        }
    }
}

impl Model {
    /// One page after the other: the first out of view or, where all are seen, the first.
    fn shrink_to(&mut self, bytes: u64) -> Vec<u8> {
        let mut evicted = Vec::new();
        while self.used_bytes() > bytes {
            let at = self.pages.iter().position(|page| !self.view.contains(&page.0)).unwrap_or(0);
            evicted.push(self.pages.remove(at).0);
        }
        evicted
    }
}

#[derive(Clone, Debug)]
enum Act {
    View(Vec<u8>),
    See(u8),
    Touch(u8),
    Admit(u8, Detail, u64),
    ShrinkTo(u64),
    Remove(u8),
}

fn act() -> impl Strategy<Value = Act> {
    let key = 0..12u8;
    let detail = prop_oneof![Just(Detail::Base), Just(Detail::Whole)];
    prop_oneof![
        1 => proptest::collection::vec(key.clone(), 0..6).prop_map(Act::View),
        1 => key.clone().prop_map(Act::See),
        3 => key.clone().prop_map(Act::Touch),
        1 => (0..200u64).prop_map(Act::ShrinkTo),
        1 => key.clone().prop_map(Act::Remove),
        6 => (key, detail, 0..60u64).prop_map(|(key, detail, bytes)| Act::Admit(key, detail, bytes)),
    ]
}

proptest! {
    #[test]
    fn it_decides_as_a_list_in_the_order_of_use_would(
        budget_bytes in 0..200u64,
        acts in proptest::collection::vec(act(), 0..120),
    ) {
        let mut pager = Pager::new(budget_bytes);
        let mut model = Model { budget_bytes, pages: Vec::new(), view: HashSet::new() };
        for act in acts {
            match act {
                Act::View(view) => {
                    model.view = view.iter().copied().collect();
                    pager.set_view(view);
                }
                Act::See(key) => {
                    model.view.insert(key);
                    pager.see(key);
                }
                Act::Touch(key) => prop_assert_eq!(pager.touch(key), model.touch(key)),
                Act::ShrinkTo(bytes) => prop_assert_eq!(pager.shrink_to(bytes), model.shrink_to(bytes)),
                Act::Remove(key) => {
                    model.pages.retain(|page| page.0 != key);
                    pager.remove(key);
                    prop_assert_eq!(pager.detail(key), None);
                }
                Act::Admit(key, detail, bytes) => {
                    let seen: Vec<u8> = model.pages.iter().map(|p| p.0).filter(|k| model.view.contains(k)).collect();
                    let admission = pager.admit(key, detail, bytes);
                    prop_assert_eq!(&admission, &model.admit(key, detail, bytes));
                    prop_assert!(!admission.evicted.iter().any(|key| seen.contains(key)), "what is in view stays");
                }
            }
            prop_assert_eq!(pager.used_bytes(), model.used_bytes());
            prop_assert!(pager.used_bytes() <= budget_bytes);
            prop_assert_eq!(pager.len(), model.pages.len());
            for (key, detail, _) in &model.pages {
                prop_assert_eq!(pager.detail(*key), Some(*detail));
            }
        }
    }

    #[test]
    fn a_plan_reads_base_layers_first_and_the_view_before_what_is_near(
        there in proptest::collection::vec((0..12u8, any::<bool>()), 0..8),
        view in proptest::collection::vec(0..6u8, 0..6),
        nearby in proptest::collection::vec(6..12u8, 0..6),
    ) {
        let mut pager = Pager::new(1000);
        for (key, whole) in there {
            pager.admit(key, if whole { Detail::Whole } else { Detail::Base }, 1);
        }
        let steps = plan(&view, &nearby, |key| pager.detail(key));
        let rank = |(key, detail): &(u8, Detail)| (*key >= 6, *detail == Detail::Whole);
        prop_assert!(steps.is_sorted_by_key(rank), "{:?}", steps);
        for key in view.iter().chain(&nearby) {
            for wanted in [Detail::Base, Detail::Whole] {
                let missing = pager.detail(*key).is_none_or(|has| has < wanted);
                prop_assert_eq!(steps.contains(&(*key, wanted)), missing);
            }
        }
    }
}

#[test]
fn when_everything_is_in_view_nothing_is_exchanged() {
    let mut pager = Pager::new(100);
    pager.set_view(0..50u32);
    for _ in 0..3 {
        for key in 0..50 {
            if pager.touch(key).is_none() {
                let admission = pager.admit(key, Detail::Whole, 10);
                assert!(admission.evicted.is_empty());
            }
        }
        assert!((0..50).all(|key| pager.detail(key).is_some() == (key < 10)));
    }
}
