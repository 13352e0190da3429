//! Which process a host listens to: one session at a time, until it falls silent. Pure.

use ipc::header::Link;

/// A session that was heard.
#[derive(Debug, Clone)]
struct Heard<S> {
    session: u64,
    since_ns: u64,
    last_ns: u64,
    /// Number of its newest state.
    sequence: u64,
    state: S,
}

/// The session that counts, and one that claims its place.
#[derive(Debug, Clone)]
pub struct Partner<S> {
    silence_ns: u64,
    bound: Option<Heard<S>>,
    rival: Option<Heard<()>>,
}

/// What became of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admitted {
    /// It is the newest of the session that counts.
    Known,
    /// It is the first of a session that counts from now on.
    First,
    /// It is the first of another session after the last one fell silent.
    Another,
    /// It is old, or of a session that does not count.
    Ignored,
}

impl<S> Partner<S> {
    /// Nobody was heard yet.
    pub fn new(silence_ns: u64) -> Self {
        Self { silence_ns, bound: None, rival: None }
    }

    /// Takes the state of a message.
    pub fn hear(&mut self, now_ns: u64, header: &Link, state: S) -> Admitted {
        let heard = |state| Heard {
            session: header.sender,
            since_ns: now_ns,
            last_ns: now_ns,
            sequence: header.sequence,
            state,
        };
        let silence_ns = self.silence_ns;
        match &mut self.bound {
            Some(bound) if bound.session == header.sender => {
                bound.last_ns = now_ns;
                if header.sequence <= bound.sequence {
                    return Admitted::Ignored;
                }
                (bound.sequence, bound.state) = (header.sequence, state);
                Admitted::Known
            }
            Some(bound) if now_ns.saturating_sub(bound.last_ns) <= silence_ns => {
                match &mut self.rival {
                    Some(rival) if rival.session == header.sender => rival.last_ns = now_ns,
                    _ => self.rival = Some(heard(state).without_state()),
                }
                Admitted::Ignored
            }
            bound => {
                let another = bound.is_some();
                *bound = Some(heard(state));
                self.rival = None;
                if another { Admitted::Another } else { Admitted::First }
            }
        }
    }

    /// Takes a sign of life beside the states. Returns whether the session counts.
    pub fn hear_more(&mut self, now_ns: u64, session: u64) -> bool {
        match self.bound.as_mut().filter(|bound| bound.session == session) {
            Some(bound) => {
                bound.last_ns = now_ns;
                true
            }
            None => false,
        }
    }

    /// The session that counts, silent or not.
    pub fn session(&self) -> Option<u64> {
        self.bound.as_ref().map(|bound| bound.session)
    }

    /// The newest state, unless the session is silent.
    pub fn state(&self, now_ns: u64) -> Option<&S> {
        let bound = self.bound.as_ref()?;
        (now_ns.saturating_sub(bound.last_ns) <= self.silence_ns).then_some(&bound.state)
    }

    /// For how long the session that counts has been silent, ms; absent: none was heard yet.
    pub fn silent_ms(&self, now_ns: u64) -> Option<u64> {
        self.bound.as_ref().map(|bound| now_ns.saturating_sub(bound.last_ns) / 1_000_000)
    }

    /// Another session that has spoken beside the one that counts for so long that it is no restart.
    pub fn rival(&self, now_ns: u64) -> Option<u64> {
        let (bound, rival) = (self.bound.as_ref()?, self.rival.as_ref()?);
        let alive = now_ns.saturating_sub(rival.last_ns) <= self.silence_ns;
        // The session that counts spoke long after the other one had begun to.
        let both = bound.last_ns.saturating_sub(rival.since_ns) > self.silence_ns;
        (alive && both).then_some(rival.session)
    }
}

impl<S> Heard<S> {
    fn without_state(self) -> Heard<()> {
        Heard {
            session: self.session,
            since_ns: self.since_ns,
            last_ns: self.last_ns,
            sequence: self.sequence,
            state: (),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(sender: u64, sequence: u64) -> Link {
        Link { sender, sequence, ..Link::default() }
    }

    #[test]
    fn old_and_doubled_states_are_ignored() {
        let mut partner = Partner::new(100);
        assert_eq!(partner.hear(0, &state(1, 5), "five"), Admitted::First);
        assert_eq!(partner.hear(1, &state(1, 5), "again"), Admitted::Ignored);
        assert_eq!(partner.hear(2, &state(1, 4), "late"), Admitted::Ignored);
        assert_eq!(partner.hear(3, &state(1, 6), "six"), Admitted::Known);
        assert_eq!(partner.state(103), Some(&"six"));
        assert_eq!(partner.state(104), None, "silent");
    }

    #[test]
    fn a_restart_takes_the_place_only_after_silence_and_is_no_rival() {
        let mut partner = Partner::new(100);
        partner.hear(0, &state(1, 5), ());
        for now in [50, 80, 100] {
            assert_eq!(partner.hear(now, &state(2, now), ()), Admitted::Ignored);
            assert_eq!(partner.rival(now), None);
        }
        assert_eq!(partner.hear(101, &state(2, 200), ()), Admitted::Another);
        assert_eq!((partner.session(), partner.rival(101)), (Some(2), None));
    }

    #[test]
    fn two_that_speak_at_once_are_told_apart() {
        let mut partner = Partner::new(100);
        for now in 0..30 {
            partner.hear(10 * now, &state(1, now + 1), ());
            partner.hear(10 * now + 5, &state(2, now + 1), ());
        }
        assert_eq!(partner.session(), Some(1));
        assert_eq!(partner.rival(300), Some(2));
        assert_eq!(partner.rival(500), None, "it is gone");
        assert!(partner.hear_more(300, 1) && !partner.hear_more(300, 2));
    }
}
