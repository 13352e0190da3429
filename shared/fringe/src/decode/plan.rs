//! From the sequence of a recording to what happens with each frame.

use super::chain::{Chain, Start};
use super::error::DecodeError;
use super::identity::Identity;
use super::limits::MAX_FRAMES;
use super::micro::{MICRO_STEPS, Micro};
use super::roles::{
    AxisPlan, CodePlan, Levels, Plan, Reference, Role, SineKind, SinePlan, StairPlan, StairSource,
};
use super::sets::{Sets, choose_chain, refuse_duplicates, residues};
use super::settings::{DecodeSettings, OrderMethod};
use crate::pattern::{Axis, PatternSet, Threshold};

impl Plan {
    /// Decides what every frame is for.
    ///
    /// # Errors
    /// Names the set that is impossible, double or missing.
    pub fn new(
        sequence: &[PatternSet],
        extent_px: [u32; 2],
        settings: &DecodeSettings,
    ) -> Result<Self, DecodeError> {
        for (index, set) in sequence.iter().enumerate() {
            set.check().map_err(|source| DecodeError::Pattern { index, name: set.name(), source })?;
        }
        refuse_duplicates(sequence)?;
        let mut count = 0_usize;
        let mut first_frame = Vec::with_capacity(sequence.len());
        for set in sequence {
            first_frame.push(count);
            count = count.saturating_add(set.frames());
            if count > MAX_FRAMES {
                return Err(DecodeError::TooManyFrames { count });
            }
        }
        let sets = Sets { list: sequence, first_frame, order: settings.order, fuse: settings.fuse };
        let mut plan = Self {
            roles: vec![Role::Ignored; count],
            sines: Vec::new(),
            stored: 0,
            homes: Vec::new(),
            axes: Vec::new(),
        };
        let mut used = vec![false; sequence.len()];
        for (axis, extent_px) in [(Axis::X, extent_px[0]), (Axis::Y, extent_px[1])] {
            if let Some(axis_plan) = plan.axis(&sets, axis, extent_px, &mut used)? {
                plan.axes.push(axis_plan);
            }
        }
        plan.name_ignored(&sets, &used)?;
        Ok(plan)
    }

    /// What proves the order of the frames along each axis; an axis then waits for all frames that its proof needs.
    pub fn identities(
        &mut self,
        sequence: &[PatternSet],
        extent_px: [u32; 2],
        pixels: usize,
    ) -> Vec<Option<Identity>> {
        let identity = |plan: &mut AxisPlan| {
            let extent_px = extent_px[usize::from(plan.axis == Axis::Y)];
            let identity = Identity::new(sequence, plan.axis, extent_px, pixels)?;
            plan.needed = plan.needed.max(identity.needed());
            Some(identity)
        };
        self.axes.iter_mut().map(identity).collect()
    }

    fn axis(
        &mut self,
        sets: &Sets,
        axis: Axis,
        extent_px: u32,
        used: &mut [bool],
    ) -> Result<Option<AxisPlan>, DecodeError> {
        let mut sines = sets.sines(axis)?;
        let micro = sets.micro(axis);
        if let Some(micro) = micro {
            sines.retain(|(index, _)| *index == micro);
        }
        let (code, too_short) = sets.code(axis, extent_px);
        if sines.is_empty() && code.is_none() {
            return too_short.map_or(Ok(None), Err);
        }
        let shifted = code.and_then(|code| sets.half_moved(code));
        let stair = sets.stair(axis).filter(|_| code.is_none() && !sines.is_empty());
        sets.demand(axis, code, shifted, stair)?;
        if extent_px == 0 {
            return Err(DecodeError::Extent { axis });
        }
        let mut plan = AxisPlan {
            fused: micro.is_some() || (sets.fuse && sines.len() > 1),
            ..AxisPlan::empty(axis, f64::from(extent_px))
        };
        let stripe_px = code.or(stair).map(|index| sets.stripe_px(index, shifted.is_some()));
        if let Some((_, finest)) = sines.first() {
            plan.period_px = finest.period_px;
            let chain = if let Some(index) = micro {
                plan.micro = Some(self.take_micro(sets, index, extent_px, &mut plan.needed)?);
                Chain::of_residues(finest.period_px)
            } else if sets.order == OrderMethod::NumberTheoretical {
                plan.residues = Some(residues(&sines, axis, extent_px)?);
                Chain::of_residues(finest.period_px)
            } else {
                choose_chain(sets.order, &sines, stripe_px, axis, extent_px)
                    .map_err(|error| too_short.unwrap_or(error))?
            };
            self.take_sines(sets, &sines, chain, &mut plan, used);
        } else {
            plan.period_px = stripe_px.unwrap_or(1.0);
        }
        if let None | Some(Start::Code) = plan.chain.as_ref().map(|c| c.start) {
            if let Some(index) = code {
                plan.code = Some(self.take_code(sets, index, &mut plan.needed, &plan.sines, used)?);
                plan.shifted = shifted
                    .map(|index| self.take_code(sets, index, &mut plan.needed, &plan.sines, used))
                    .transpose()?;
            } else if let Some(index) = stair {
                plan.stair = Some(self.take_stair(sets, index, extent_px, &mut plan.needed, used)?);
            }
        }
        if !plan.sines.is_empty()
            && let Some((white, black)) = sets.first_of("white").zip(sets.first_of("black"))
        {
            let white = self.store(sets, white, &mut plan.needed, used);
            plan.levels = Some(Levels { white, black: self.store(sets, black, &mut plan.needed, used) });
        }
        Ok(Some(plan))
    }

    /// Gives the sines of the chain their slots and renumbers its terms accordingly.
    fn take_sines(
        &mut self,
        sets: &Sets,
        sines: &[(usize, SinePlan)],
        mut chain: Chain,
        plan: &mut AxisPlan,
        used: &mut [bool],
    ) {
        let all = plan.fused || plan.residues.is_some();
        let in_chain =
            |j: usize| all || chain.stages.iter().any(|stage| stage.terms.iter().any(|term| term.0 == j));
        let kept: Vec<usize> = (0..sines.len()).filter(|j| in_chain(*j)).collect();
        for stage in &mut chain.stages {
            for term in &mut stage.terms {
                term.0 = kept.iter().position(|j| *j == term.0).unwrap_or(0);
            }
        }
        for j in kept {
            let (index, mut sine) = sines[j].clone();
            let slot = self.sines.len();
            let frames = sine.rasters().len();
            sine.first = self.reserve(frames);
            for step in 0..frames {
                self.roles[sets.first_frame[index] + step] = Role::Sine { slot, step };
            }
            used[index] = true;
            plan.sines.push(slot);
            plan.needed = plan.needed.max(sets.first_frame[index] + frames);
            self.sines.push(sine);
        }
        plan.chain = Some(chain);
    }

    /// Keeps the frames of the further frequencies of a micro set.
    fn take_micro(
        &mut self,
        sets: &Sets,
        index: usize,
        extent_px: u32,
        needed: &mut usize,
    ) -> Result<Micro, DecodeError> {
        let set = &sets.list[index];
        let frames = set.frames();
        let first = self.reserve(frames - MICRO_STEPS);
        for step in MICRO_STEPS..frames {
            self.roles[sets.first_frame[index] + step] = Role::Stored(first + step - MICRO_STEPS);
        }
        *needed = (*needed).max(sets.first_frame[index] + frames);
        Micro::new(set, first, extent_px)
    }

    fn take_code(
        &mut self,
        sets: &Sets,
        index: usize,
        needed: &mut usize,
        sines: &[usize],
        used: &mut [bool],
    ) -> Result<CodePlan, DecodeError> {
        let PatternSet::Gray { axis, bits, stripe_px, shift_px, invert, code, threshold } = sets.list[index]
        else {
            return Err(DecodeError::NothingToDecode);
        };
        let missing = |missing| DecodeError::MissingThreshold { index, axis, wanted: threshold, missing };
        let complement = sets.complement(index);
        let white_black = sets.first_of("white").zip(sets.first_of("black"));
        let source = match threshold {
            Some(named) => named,
            None if complement.is_some() => Threshold::Complement,
            None if white_black.is_some() => Threshold::WhiteBlack,
            None => Threshold::SineMean,
        };
        let reference = match source {
            Threshold::Complement => {
                let other = complement.ok_or_else(|| {
                    missing("a complementary set (same axis, bits, stripe_px, code; invert = true)")
                })?;
                Reference::Complement(self.store(sets, other, needed, used))
            }
            Threshold::WhiteBlack => {
                let (white, black) = white_black.ok_or_else(|| missing("a white and a black frame"))?;
                Reference::WhiteBlack(
                    self.store(sets, white, needed, used),
                    self.store(sets, black, needed, used),
                )
            }
            Threshold::SineMean => {
                Reference::SineMean(self.mean_slot(sets, axis, sines).ok_or_else(|| {
                    missing("a sine set on the axis, white and black frames, or a complementary set")
                })?)
            }
        };
        let first = self.store(sets, index, needed, used);
        Ok(CodePlan { first, bits: bits as usize, stripe_px, shift_px, invert, code, reference })
    }

    fn take_stair(
        &mut self,
        sets: &Sets,
        index: usize,
        extent_px: u32,
        needed: &mut usize,
        used: &mut [bool],
    ) -> Result<StairPlan, DecodeError> {
        let set = &sets.list[index];
        let PatternSet::Stair { axis, stair_px, steps } = *set else {
            return Err(DecodeError::NothingToDecode);
        };
        let source = if steps == 1 {
            let (white, black) =
                sets.first_of("white").zip(sets.first_of("black")).ok_or(DecodeError::OrderSet {
                    order: "stair",
                    axis,
                    missing: "a white and a black frame".into(),
                })?;
            let levels = Levels {
                white: self.store(sets, white, needed, used),
                black: self.store(sets, black, needed, used),
            };
            StairSource::Grey(self.store(sets, index, needed, used), levels)
        } else {
            let slot = self.sines.len();
            let shifts_rad = (0..steps as usize).map(|step| set.step_rad(step)).collect();
            let first = self.reserve(steps as usize);
            self.sines.push(SinePlan {
                index,
                axis,
                period_px: stair_px,
                steps,
                first,
                shifts_rad,
                even: true,
                kind: SineKind::Plain,
            });
            for step in 0..steps as usize {
                self.roles[sets.first_frame[index] + step] = Role::Sine { slot, step };
            }
            used[index] = true;
            *needed = (*needed).max(sets.first_frame[index] + steps as usize);
            StairSource::Phase(slot)
        };
        Ok(StairPlan { stair_px, stairs: (f64::from(extent_px) / stair_px).ceil(), source })
    }

    /// Slot of the first sine in the sequence among those in use on the axis.
    fn mean_slot(&self, sets: &Sets, axis: Axis, sines: &[usize]) -> Option<usize> {
        let mut slots = sets.first_frame.iter().filter_map(|frame| match self.roles.get(*frame) {
            Some(Role::Sine { slot, .. }) if self.sines[*slot].axis == axis => Some(*slot),
            _ => None,
        });
        // The mean of lines or of a carrier is not halfway between black and white.
        slots.find(|slot| sines.contains(slot) && self.sines[*slot].kind == SineKind::Plain)
    }

    /// Keeps all frames of a set; a set that two axes share (white, black) is kept once.
    fn store(&mut self, sets: &Sets, index: usize, needed: &mut usize, used: &mut [bool]) -> usize {
        let first_frame = sets.first_frame[index];
        let frames = sets.list[index].frames();
        *needed = (*needed).max(first_frame + frames);
        used[index] = true;
        if let Some(Role::Stored(first)) = self.roles.get(first_frame) {
            return *first;
        }
        let first = self.reserve(frames);
        for step in 0..frames {
            self.roles[first_frame + step] = Role::Stored(first + step);
            self.homes[first + step] = (index, step);
        }
        first
    }

    /// Room for so many rasters; the first of them.
    fn reserve(&mut self, frames: usize) -> usize {
        let first = self.stored;
        self.stored += frames;
        self.homes.resize(self.stored, (0, 0));
        first
    }

    /// Distributes the unused sets over the reports: to the report of their axis, else to the first one.
    fn name_ignored(&mut self, sets: &Sets, used: &[bool]) -> Result<(), DecodeError> {
        if self.axes.is_empty() {
            return Err(DecodeError::NothingToDecode);
        }
        for (index, set) in sets
            .list
            .iter()
            .enumerate()
            .filter(|(index, set)| !used[*index] && !matches!(set, PatternSet::Check { .. }))
        {
            let home = self.axes.iter().position(|a| Some(a.axis) == set.axis()).unwrap_or(0);
            self.axes[home].ignored.push(format!("set {} (\"{}\")", index + 1, set.name()));
        }
        Ok(())
    }
}

/// The axes along which a sequence gives a phase, x before y, without the memory of a decoder.
///
/// # Errors
/// As [`Decoder::new`].
pub fn decoded_axes(
    sequence: &[PatternSet],
    extent_px: [u32; 2],
    settings: &DecodeSettings,
) -> Result<Vec<Axis>, DecodeError> {
    Ok(Plan::new(sequence, extent_px, settings)?.axes.iter().map(|axis| axis.axis).collect())
}
