//! Touches as whoever follows a stream is told of them.

use eit_inverse::touch::{Touch, TouchState};

/// The touches that were listed last. Ids are never used again, and touches that were said to have ended do not go on.
#[derive(Debug)]
pub(super) struct ListedTouches {
    pub touches: Vec<Touch>,
    /// Id of the next epoch's first touch.
    pub first_id: u64,
    /// Added to the ids of the epoch's finder, some of whose touches have ended for everybody else.
    id_offset: u64,
    /// Whether the list that was made last says that all touches have ended.
    is_ended: bool,
}

impl ListedTouches {
    /// No touches, all of which have ended.
    pub(super) fn new() -> Self {
        Self { touches: Vec::new(), first_id: 1, id_offset: 0, is_ended: true }
    }

    /// Ends an epoch whose next touch would have this id.
    pub(super) fn end_epoch(&mut self, next_id: u64) {
        self.first_id = next_id + std::mem::take(&mut self.id_offset);
    }

    /// Clears the list for the next frame, before which a new touch would have the id `next_id`. What goes on after it
    /// was said to have ended is another touch to whoever was told: returns whether there is any.
    pub(super) fn clear(&mut self, next_id: u64) -> bool {
        let is_resumed = self.is_ended && !self.touches.is_empty();
        if is_resumed {
            self.id_offset += next_id - 1;
        }
        self.touches.clear();
        is_resumed
    }

    /// Lists the touches that a finder has found.
    pub(super) fn take(&mut self, found: &[Touch], is_resumed: bool) {
        let offset = self.id_offset;
        self.touches.extend(found.iter().map(|touch| Touch {
            id: touch.id + offset,
            state: match touch.state {
                TouchState::Hold if is_resumed => TouchState::Begin,
                state => state,
            },
            split_from: touch.split_from.map(|id| id + offset),
            merged_into: touch.merged_into.map(|id| id + offset),
            ..*touch
        }));
        self.is_ended = false;
    }

    /// Ends the touches; returns false if they have ended already.
    pub(super) fn end(&mut self) -> bool {
        if std::mem::replace(&mut self.is_ended, true) {
            return false;
        }
        self.touches.retain(|touch| touch.state != TouchState::End);
        for touch in &mut self.touches {
            (touch.state, touch.valid) = (TouchState::End, false);
        }
        true
    }
}
