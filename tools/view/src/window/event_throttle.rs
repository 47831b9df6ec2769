//! Clicks one at a time: what came in the course of a slow frame is shown to the widgets in several.

use std::collections::VecDeque;

use eframe::egui::Event;

/// What waits for later frames.
///
/// A frame's widgets see the pointer where it was last. Where a machine under load brings two clicks in one frame, the first
/// would be lost, and so would one that comes before anything was drawn that it could meet.
#[derive(Default)]
pub(super) struct Waiting(VecDeque<Event>);

impl Waiting {
    /// Leaves in `events` what this frame may see, in order with what has waited: up to the first press or release of a
    /// button, and none before `is_drawn`. Whether something waits.
    pub(super) fn take_turns(&mut self, events: &mut Vec<Event>, is_drawn: bool) -> bool {
        self.0.extend(events.drain(..));
        while let Some(event) = self.0.pop_front() {
            let is_button = matches!(event, Event::PointerButton { .. });
            if is_button && !is_drawn {
                self.0.push_front(event);
                break;
            }
            events.push(event);
            if is_button {
                break;
            }
        }
        !self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Modifiers, PointerButton, pos2};

    #[test]
    fn each_press_and_release_has_a_frame_with_what_came_before_it() {
        let moved = |x| Event::PointerMoved(pos2(x, 0.0));
        let button = |x, pressed| {
            let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
            Event::PointerButton { pos: pos2(x, 0.0), button, pressed, modifiers }
        };
        let all = [moved(1.0), button(1.0, true), button(1.0, false), moved(2.0), button(2.0, true), Event::Copy];
        let mut waiting = Waiting::default();
        let mut events = all.to_vec();
        assert!(waiting.take_turns(&mut events, false));
        assert_eq!(events, all[..1], "nothing is pressed before there is something to press");
        let mut frames = Vec::new();
        for _ in 0..4 {
            let mut events = Vec::new();
            let waits = waiting.take_turns(&mut events, true);
            frames.push((events, waits));
        }
        let parts = [&all[1..2], &all[2..3], &all[3..5], &all[5..6]];
        for (frame, (part, waits)) in frames.iter().zip(parts.into_iter().zip([true, true, true, false])) {
            assert_eq!((frame.0.as_slice(), frame.1), (part, waits));
        }
        assert!(!waiting.take_turns(&mut Vec::new(), true));
    }
}
