//! What goes wrong in a cycle of simulated cameras, drawn from a seed: the same seed gives the same storm.

use fringe::decode::OrderEvent;
use fringe::math::random::Key;

/// What happens to one camera in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Calamity {
    /// The frames are not in their order.
    Order(OrderEvent),
    /// The frame never comes.
    Never(usize),
    /// The frame lacks its last row.
    Short(usize),
    /// From the frame on the camera answers nothing for some seconds.
    Silent(usize),
}

/// The calamity of a camera in a cycle whose sequence has so many frames; none in half of the cycles.
pub(crate) fn draw(seed: u64, camera: usize, cycle: u64, frames: usize) -> Option<Calamity> {
    let key = Key::new(seed).with(camera as u64).with(cycle);
    let below = |counter: u64, most: usize| (key.bits(counter) % most.max(1) as u64) as usize;
    let frame = below(1, frames);
    Some(match below(0, 14) {
        0 => Calamity::Order(OrderEvent::Lost(frame)),
        1 => Calamity::Order(OrderEvent::Twice(frame)),
        2 if frames > 1 => Calamity::Order(OrderEvent::Repeated(frame.max(1))),
        3 if frames > 1 => {
            Calamity::Order(OrderEvent::Exchanged(frame, (frame + 1 + below(2, frames - 1)) % frames))
        }
        4 => Calamity::Never(frame),
        5 => Calamity::Short(frame),
        6 => Calamity::Silent(frame),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_storm_has_every_calamity_and_calm_cycles_and_comes_again() {
        let storm = |seed| (0..500).map(|cycle| draw(seed, 0, cycle, 14)).collect::<Vec<_>>();
        let (one, again, other) = (storm(1), storm(1), storm(2));
        assert!(one == again && one != other);
        let calm = one.iter().filter(|calamity| calamity.is_none()).count();
        assert!((180..320).contains(&calm), "{calm}");
        let some = |is: fn(&Calamity) -> bool| one.iter().flatten().any(is);
        assert!(some(|c| matches!(c, Calamity::Order(OrderEvent::Exchanged(..)))));
        assert!(some(|c| matches!(c, Calamity::Never(_))) && some(|c| matches!(c, Calamity::Silent(_))));
        assert!(
            draw(1, 0, 0, 1)
                .is_none_or(|c| !matches!(c, Calamity::Order(OrderEvent::Exchanged(a, b)) if a == b))
        );
    }
}
