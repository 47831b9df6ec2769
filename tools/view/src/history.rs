//! Undo and redo, where one drag is one step.

use std::collections::VecDeque;

/// Steps that are kept.
const LONGEST: usize = 500;

/// States that were, that is, and that were undone.
#[derive(Clone, Debug)]
pub struct History<S> {
    past: VecDeque<S>,
    present: S,
    future: Vec<S>,
}

impl<S: Clone + PartialEq> History<S> {
    /// Begins with a state that cannot be undone.
    pub fn new(present: S) -> Self {
        Self { past: VecDeque::new(), present, future: Vec::new() }
    }

    /// Makes another state of each, of those to undo and redo too.
    pub fn map(&mut self, make: impl Fn(&S) -> S) {
        let states = self.past.iter_mut().chain([&mut self.present]).chain(&mut self.future);
        states.for_each(|state| *state = make(state));
    }

    /// Looks at the state once a frame. While something is `held` (a mouse button, a key that repeats) changes belong
    /// to the step in the making; it is done when it is let go.
    pub fn observe(&mut self, state: &S, held: bool) {
        if held || *state == self.present {
            return;
        }
        self.past.push_back(std::mem::replace(&mut self.present, state.clone()));
        self.future.clear();
        if self.past.len() > LONGEST {
            self.past.pop_front();
        }
    }

    /// Whether there is something to undo.
    pub fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    /// Whether there is something to redo.
    pub fn can_redo(&self) -> bool {
        !self.future.is_empty()
    }

    /// One step back; the state to show.
    pub fn undo(&mut self) -> Option<S> {
        let state = self.past.pop_back()?;
        self.future.push(std::mem::replace(&mut self.present, state));
        Some(self.present.clone())
    }

    /// One step forth again; the state to show.
    pub fn redo(&mut self) -> Option<S> {
        let state = self.future.pop()?;
        self.past.push_back(std::mem::replace(&mut self.present, state));
        Some(self.present.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drag_is_one_step() {
        let mut history = History::new(0);
        for state in 1..50 {
            history.observe(&state, true);
        }
        history.observe(&50, false);
        history.observe(&50, false);
        assert_eq!(history.undo(), Some(0));
        assert_eq!(history.undo(), None);
        assert_eq!(history.redo(), Some(50));
        assert!(!history.can_redo());
    }

    #[test]
    fn a_drag_that_comes_back_is_no_step() {
        let mut history = History::new(0);
        history.observe(&7, true);
        history.observe(&0, false);
        assert!(!history.can_undo());
    }

    #[test]
    fn a_new_change_forgets_what_was_undone() {
        let mut history = History::new(0);
        history.observe(&1, false);
        history.observe(&2, false);
        history.undo();
        history.observe(&3, false);
        assert!(!history.can_redo());
        assert_eq!(history.undo(), Some(1));
    }

    #[test]
    fn all_states_are_made_anew() {
        let mut history = History::new(0);
        (1..4).for_each(|state| history.observe(&state, false));
        history.undo();
        history.map(|state| state * 10);
        assert_eq!((history.redo(), history.undo(), history.undo()), (Some(30), Some(20), Some(10)));
        history.observe(&10, false);
        assert_eq!(history.undo(), Some(0), "the present one was made anew too");
    }

    #[test]
    fn the_oldest_steps_are_forgotten_first() {
        let mut history = History::new(0);
        (1..=LONGEST + 10).for_each(|state| history.observe(&state, false));
        let mut last = None;
        while let Some(state) = history.undo() {
            last = Some(state);
        }
        assert_eq!(last, Some(10));
    }
}
