//! Taking clouds: cutting them into pieces, a first look at their points, sorting them into cells. The first clouds can be taken while the
//! others do not exist yet.

use super::buffers::reserve;
use super::cells::Cells;
use super::grid::{Extent, Grid, Lattice};
use super::isolated::mark_beside;
use super::scale::Scale;
use super::{Fuser, FusionSettings, PIECE, Piece};
use crate::cloud::Point;
use crate::math::parallel::for_parts;
use rayon::prelude::*;

/// A cloud that was taken before the others were there: where its points lie, and how many they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Taken {
    address: usize,
    points: usize,
}

impl Taken {
    fn of(points: &[Point]) -> Self {
        Self { address: points.as_ptr().addr(), points: points.len() }
    }
}

impl Fuser {
    /// Takes a cloud before the others are there: [`Self::fuse`] has less to do with it then, and gives the same. Clouds are taken in their
    /// order, from number 0 on; their points must stay as they are until all are fused, and [`Self::forget`] is due where it does not come to that.
    /// One that comes out of turn, or does not tell the radius of a neighbourhood, is taken together with the others instead.
    pub fn take(&mut self, number: usize, points: &[Point], settings: &FusionSettings) {
        if number == 0 {
            self.forget();
            self.begun =
                Scale::of_first(&[points], settings, &mut self.spacings).map(|scale| (scale, *settings));
        }
        let Some((scale, of)) = self.begun else { return };
        if number != self.taken.len() || of != *settings {
            return;
        }
        self.cut(number, points);
        let extent = self.look((number, &[points]), scale.radius_mm, settings.min_neighbours);
        self.per_cloud.resize_with(self.per_cloud.len().max(number + 1), Cells::default);
        if let Some(grid) = Grid::over(Lattice::new(scale.origin_mm, scale.radius_mm, &extent), &extent) {
            self.per_cloud[number].fill(&grid, points);
            self.mark((number, &[points]), &grid, scale.radius_mm, settings.min_neighbours);
        } else {
            self.per_cloud[number].clear();
        }
        self.taken.push(Taken::of(points));
    }

    /// Forgets the clouds that were taken.
    pub fn forget(&mut self) {
        self.begun = None;
        self.taken.clear();
        self.pieces.clear();
        self.starts.clear();
        self.keep.clear();
    }

    /// Forgets what was taken of other clouds or with other settings. Returns how many clouds are taken, and the scale of them.
    pub(super) fn keep_taken(
        &mut self,
        clouds: &[&[Point]],
        settings: &FusionSettings,
    ) -> (usize, Option<Scale>) {
        let are_these = self.taken.len() <= clouds.len()
            && self.taken.iter().zip(clouds).all(|(taken, cloud)| *taken == Taken::of(cloud));
        if !are_these || self.begun.is_some_and(|(_, of)| of != *settings) {
            self.forget();
        }
        (self.taken.len(), self.begun.map(|(scale, _)| scale))
    }

    /// Cuts the next cloud into pieces.
    pub(super) fn cut(&mut self, cloud: usize, points: &[Point]) {
        let pieces = points.len().div_ceil(PIECE);
        reserve(&mut self.pieces, pieces);
        reserve(&mut self.starts, pieces + 1);
        let mut start = self.starts.pop().unwrap_or_default();
        for first in (0..points.len()).step_by(PIECE) {
            let end = (first + PIECE).min(points.len());
            self.pieces.push(Piece { cloud, first, end, extent: Extent::default(), kept: 0 });
            self.starts.push(start);
            start += end - first;
        }
        self.starts.push(start);
    }

    /// The first look at all points of some clouds, which were cut last: the box that holds them and those before, and which have enough
    /// neighbours beside them in the list.
    pub(super) fn look(
        &mut self,
        (first, clouds): (usize, &[&[Point]]),
        radius_mm: f64,
        min_neighbours: u32,
    ) -> Extent {
        let limit = radius_mm * radius_mm;
        let count = self.starts.last().copied().unwrap_or_default();
        let before = self.keep.len();
        reserve(&mut self.keep, count - before);
        self.keep.resize(count, false);
        let pieces = self.pieces.partition_point(|piece| piece.cloud < first);
        let (starts, keep) = (&self.starts[pieces..], &mut self.keep[before..]);
        for_parts(starts, keep, &mut self.pieces[pieces..], &|_, keep, piece| {
            let cloud = clouds[piece.cloud - first];
            piece.extent = Extent::of(&cloud[piece.first..piece.end]);
            mark_beside(cloud, piece.first, limit, min_neighbours, keep);
        });
        self.pieces.iter().fold(Extent::default(), |all, piece| all.and(&piece.extent))
    }

    /// Sorts the clouds into the cells of a grid; of those that were taken, cells only change their keys.
    pub(super) fn fill(&mut self, taken: usize, clouds: &[&[Point]], grid: &Grid) {
        self.per_cloud.resize_with(self.per_cloud.len().max(clouds.len()), Cells::default);
        self.per_cloud.par_iter_mut().zip(clouds).enumerate().for_each(|(number, (cells, cloud))| {
            if number >= taken || !cells.move_to(grid) {
                cells.fill(grid, cloud);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{patch, plane, sphere};
    use super::super::{FusionReport, fuse};
    use super::*;

    /// Takes one of two clouds, perhaps with other settings, in a way that is of no use.
    type Spoil = fn(&mut Fuser, &[Point], &[Point], &FusionSettings);

    fn place(point: &Point, position_mm: [f64; 3]) -> Point {
        Point { position_mm, ..*point }
    }

    /// Report and points, where so many clouds are taken before.
    fn fused(
        fuser: &mut Fuser,
        clouds: &[&[Point]],
        taken: usize,
        settings: &FusionSettings,
    ) -> (FusionReport, Vec<Point>) {
        for (number, cloud) in clouds[..taken].iter().enumerate() {
            fuser.take(number, cloud, settings);
        }
        let mut out = Vec::new();
        let report = fuser.fuse(clouds, settings, &mut out).clone();
        (report, out)
    }

    /// Proves: whichever clouds are taken before the others, points and report are the same, byte by byte: where the later clouds lie beside,
    /// below or far from the first one, where it has no points, few or strange ones, and where the settings give a radius.
    #[test]
    fn clouds_that_were_taken_before_give_the_same() {
        let (near, far) = (patch(plane(0.0), 0.0, 0.01, 1), patch(plane(0.02), -8.0, 0.01, 2));
        let ball = patch(sphere(20.0), 0.1, 0.01, 3);
        let strange: Vec<Point> = near.iter().map(|p| place(p, [f64::NAN, 0.0, f64::INFINITY])).collect();
        let absurd: Vec<Point> = [-1e300, 3.0, 1e300].map(|x| place(&near[0], [x, 1.0, 2.0])).to_vec();
        let beyond: Vec<Point> = [-1.7e308, 1.7e308].map(|x| place(&near[0], [x, x, 2.0])).to_vec();
        let at_once = vec![near[0]; 200];
        let lists: [&[&[Point]]; 11] = [
            &[&near, &far],
            &[&near, &far, &ball],
            &[&ball, &near[..30], &far],
            &[&near[..30], &near, &far],
            &[&[], &near, &far],
            &[&near, &[], &far],
            &[&strange, &near, &far],
            &[&near, &absurd, &far],
            &[&absurd, &near],
            &[&near, &beyond],
            &[&at_once, &near],
        ];
        let given = FusionSettings { radius_mm: Some(0.45), ..FusionSettings::default() };
        let mut fuser = Fuser::default();
        for settings in [FusionSettings::default(), given] {
            for (case, clouds) in lists.iter().enumerate() {
                let expected = fused(&mut Fuser::default(), clouds, 0, &settings);
                for taken in 1..=clouds.len() {
                    let found = fused(&mut fuser, clouds, taken, &settings);
                    assert_eq!(found.0, expected.0, "case {case}, {taken} taken");
                    let [found, expected] =
                        [&found.1, &expected.1].map(|points| bytemuck::cast_slice::<_, u8>(points));
                    assert!(found == expected, "case {case}, {taken} taken");
                }
            }
        }
    }

    /// Proves: what was taken of other clouds, out of turn, with other settings or before a cycle that was given up changes nothing.
    #[test]
    fn what_was_taken_in_vain_changes_nothing() {
        let (a, b) = (patch(plane(0.0), 0.0, 0.01, 1), patch(sphere(20.0), 0.1, 0.01, 2));
        let settings = FusionSettings::default();
        let other = FusionSettings { min_neighbours: 9, ..settings };
        let mut expected = Vec::new();
        let report = fuse(&[&a, &b], &settings, &mut expected);
        let spoils: [Spoil; 6] = [
            |fuser, _, b, _| fuser.take(0, b, &FusionSettings::default()),
            |fuser, a, _, other| fuser.take(0, a, other),
            |fuser, _, b, _| fuser.take(1, b, &FusionSettings::default()),
            |fuser, a, b, _| {
                fuser.take(0, a, &FusionSettings::default());
                fuser.take(2, b, &FusionSettings::default());
            },
            |fuser, a, _, other| {
                fuser.take(0, a, &FusionSettings::default());
                fuser.take(1, a, other);
            },
            |fuser, a, b, _| {
                (0..2).for_each(|number| fuser.take(number, [a, b][number], &FusionSettings::default()));
                fuser.take(2, a, &FusionSettings::default());
            },
        ];
        let mut fuser = Fuser::default();
        for (number, spoil) in spoils.iter().enumerate() {
            spoil(&mut fuser, &a, &b, &other);
            let (again, out) = fused(&mut fuser, &[&a, &b], 0, &settings);
            assert!((&again, &out) == (&report, &expected), "{number}");
        }
    }
}
