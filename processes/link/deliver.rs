//! The stage `link` of a host that is led: takes cycles from the host that leads, and gives it the clouds.

use super::follower::Follower;
use super::speaker::{End, Speaker};
use super::{identity, plan};
use crate::stage::{Fault, Inbox, Report, StageContext, Worker, cycle_fault};
use anyhow::{Result, anyhow};
use cell::schedule::Work;
use fringe::cloud::Point;
use ipc::IpcError;
use ipc::header::{Cloud, EventKind, Outcome};
use ipc::link::{LinkEnd, new_session};
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Publisher, Received};

/// Pause between two looks at what came, ns.
const LOOK_NS: u64 = 2_000_000;

/// How long a trouble has to last until an operator is told, ns.
const TELL_AFTER_NS: u64 = 5_000_000_000;

/// The result of a host that is led: it inspects nothing.
const NO_RESULT: &[u8] = b"null";

/// A pair of this host.
struct Part {
    pair: usize,
    inbox: Inbox<Cloud>,
    cloud: Option<Received<Cloud>>,
}

/// The link of a host that is led.
pub struct Deliver {
    speaker: Speaker,
    parts: Vec<Part>,
    results: Publisher<Outcome>,
    /// The cycle that was requested of the supervisor and has not begun.
    pending: Option<u64>,
    handed_over: bool,
    offered: bool,
    /// Whether the cycle is delivered; it stays the current one of the stage until the next begins.
    finished: bool,
    /// Whether the supervisor knows of another run of the host that leads.
    renewed: bool,
    /// Time of the last frame, ns.
    t_last_frame_ns: u64,
    /// Since when no cycle can come, ns, and whether an operator was told.
    trouble: Option<(u64, bool)>,
}

impl Deliver {
    /// Opens the link and the ports.
    pub fn new(context: &StageContext) -> Result<Self> {
        let (cell, graph) = (&context.cell, &context.cell.graph);
        let pairs = (0..graph.pairs.len()).filter(|&pair| graph.has_pair(pair));
        let part = |pair: usize| {
            let inbox = Inbox::subscribe(context, &format!("cloud/{}", graph.pairs[pair].name))?;
            Ok(Part { pair, inbox, cloud: None })
        };
        let (session, own) = (new_session()?, identity(cell)?);
        let silence_ns = cell.config.limits.silence_ms.saturating_mul(1_000_000);
        let end = LinkEnd::Follows(own.host.clone());
        let follower = Box::new(Follower::new(own, session, silence_ns));
        Ok(Self {
            speaker: Speaker::start(plan(cell, end)?, session, End::Follows(follower))?,
            parts: pairs.map(part).collect::<Result<_>>()?,
            results: context.publisher("result")?,
            pending: None,
            handed_over: false,
            offered: false,
            finished: false,
            renewed: false,
            t_last_frame_ns: 0,
            trouble: None,
        })
    }

    fn follower<T>(&self, ask: impl FnOnce(&mut Follower) -> T) -> Result<T, Fault> {
        self.speaker.follower(ask).map_err(Fault::Fatal)
    }

    /// Ends the stage if this process may not be a host, and begins anew after a start of the host that leads.
    fn check(&mut self, context: &StageContext) -> Result<(), Fault> {
        if let Some(refused) = self.follower(|f| f.refused().map(str::to_owned))? {
            return Err(Fault::Fatal(anyhow!("{refused}")));
        }
        if !self.renewed && self.follower(|f| f.must_renew())? {
            self.renewed = true;
            context.announce(EventKind::Renew, 0, "the host that leads was started again")?;
        }
        Ok(())
    }

    /// Tells an operator, once, why nothing happens here.
    fn tell_trouble(&mut self, now_ns: u64) -> Result<(), Fault> {
        let Some(reason) = self.follower(|f| f.trouble(now_ns))? else {
            self.trouble = None;
            return Ok(());
        };
        let (since_ns, told) = self.trouble.get_or_insert((now_ns, false));
        if !*told && now_ns.saturating_sub(*since_ns) > TELL_AFTER_NS {
            *told = true;
            tracing::warn!("{reason}");
        }
        Ok(())
    }

    fn deliver(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        let start_ns = now_ns();
        let header = Outcome {
            cycle: context.cycle(),
            t_ns: start_ns,
            t_last_frame_ns: self.t_last_frame_ns,
            text_bytes: NO_RESULT.len() as u32,
        };
        context.sending(|| self.results.send(header, NO_RESULT))?;
        self.follower(Follower::delivered)?;
        self.clear();
        self.finished = true;
        context.done(Work::Deliver, start_ns, NO_RESULT, Report::default())
    }

    /// Offers the clouds to the host that leads.
    fn offer(&mut self) -> Result<(), Fault> {
        let mut clouds = Vec::new();
        for part in &self.parts {
            let Some(cloud) = &part.cloud else { return Ok(()) };
            payload::points(cloud.header(), cloud.payload()).map_err(|e| cycle_fault(&e))?;
            let points = cloud.header().points;
            self.t_last_frame_ns = self.t_last_frame_ns.max(cloud.header().t_ns);
            let bytes = cloud.payload()[..points as usize * size_of::<Point>()].to_vec();
            clouds.push((part.pair as u32, points, bytes));
        }
        self.offered = true;
        self.follower(|f| f.matched(clouds))
    }

    fn clear(&mut self) {
        self.handed_over = false;
        self.offered = false;
        self.finished = false;
        self.t_last_frame_ns = 0;
        for part in &mut self.parts {
            part.cloud = None;
        }
    }
}

impl Worker for Deliver {
    fn connect(&mut self) -> Result<(), IpcError> {
        // A link that is broken ends the stage with its next step.
        let _ = self.speaker.follower(Follower::set_ready);
        self.parts.iter_mut().try_for_each(|part| part.inbox.connect())
    }

    fn idle(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        self.check(context)?;
        let now = now_ns();
        self.tell_trouble(now)?;
        if let Some(cycle) = self.pending {
            if let Err(reason) = self.follower(|f| f.is_delivered(now))? {
                self.pending = None;
                context.announce(EventKind::Withdraw, cycle, &reason)?;
            }
        } else if let Some(cycle) = self.follower(|f| f.wanted(now))? {
            self.follower(|f| f.requested(cycle))?;
            self.pending = Some(cycle);
            context.announce(EventKind::Request, cycle, "")?;
        }
        Ok(())
    }

    fn begin(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        self.clear();
        self.pending = None;
        let cycle = context.cycle();
        self.follower(|f| f.begin(cycle))
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        if self.finished {
            return self.idle(context).map(|()| false);
        }
        self.check(context)?;
        let delivered = self.follower(|f| f.is_delivered(now_ns()))?.map_err(Fault::Cycle)?;
        if !self.handed_over && context.may_start(Work::HandOver) {
            let start_ns = now_ns();
            self.handed_over = true;
            self.follower(Follower::acquired)?;
            context.done(Work::HandOver, start_ns, &[], Report::default())?;
            return Ok(true);
        }
        let turn = context.may_start(Work::Deliver);
        for part in &mut self.parts {
            if let Some(message) = part.inbox.take(context)? {
                if part.cloud.is_some() || message.header().pair as usize != part.pair {
                    return Err(Fault::Cycle("a cloud came twice or out of place".into()));
                }
                part.cloud = Some(message);
                return Ok(true);
            }
        }
        if turn && !self.offered {
            self.parts.iter().try_for_each(|part| part.inbox.check_not_overtaken(context))?;
            self.offer()?;
            return Ok(self.offered);
        }
        if self.offered && delivered {
            self.deliver(context)?;
            return Ok(true);
        }
        Ok(false)
    }

    fn forget(&mut self) {
        self.clear();
        // A link that is broken ends the stage with its next step.
        let _ = self.speaker.follower(Follower::failed);
    }

    fn due_ns(&self) -> Option<u64> {
        Some(now_ns() + LOOK_NS)
    }
}
