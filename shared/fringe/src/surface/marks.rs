//! What pixels know of rims and limbs nearby, as bits.

/// Mark of a pixel of the other view at a rim.
pub(crate) const RIM: u8 = 1;
/// Mark of a pixel near to where phases end in the picture of its own camera …
pub(crate) const OWN: u8 = 2;
/// … and of one whose match is in the picture of the other.
pub(crate) const OTHER: u8 = 4;
/// What these are shifted by where phases do not end, but bend …
pub(super) const BENT: u32 = 2;
/// … and where they bend so near that a rim may be there.
pub(super) const SPLIT: u32 = 4;

/// Whether a surface ends at a silhouette in one of the pictures where phases jump so little that they only bend, in that picture alone. What both
/// pictures show is a crease of the part.
#[inline(always)]
pub(super) fn ends_here(marks: u8) -> bool {
    let alone = |own: u8, other: u8| marks & own << SPLIT != 0 && marks & other << BENT == 0;
    alone(OWN, OTHER) || alone(OTHER, OWN)
}
