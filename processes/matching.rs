//! The matching process of one pair: takes its phases, gives its cloud.

use crate::stage::{Fault, Inbox, Link, Report, TextBuffer, Worker, lost};
use anyhow::Result;
use cell::executor::{PairMatcher, Views, pair_matcher};
use cell::schedule::Work;
use fringe::cloud::Point;
use fringe::pattern::Axis;
use ipc::IpcError;
use ipc::header::{Cloud, Phase};
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Publisher, Received};
use xxhash_rust::xxh3::xxh3_128;

/// A phase that the pair waits for.
struct Need {
    camera: usize,
    axis: Axis,
    map: Option<Received<Phase>>,
}

/// State of a matching stage.
pub struct Matching {
    pair: usize,
    projector: usize,
    left: usize,
    matcher: PairMatcher,
    needs: Vec<Need>,
    inboxes: Vec<Inbox<Phase>>,
    clouds: Publisher<Cloud>,
    text: TextBuffer,
}

impl Matching {
    /// Computes the tables and opens the ports.
    pub fn new(link: &Link) -> Result<Self> {
        let (cell, pair) = (&link.cell, link.subject());
        let node = &cell.graph.pairs[pair];
        let axes = node.axes(&cell.graph.projectors[node.projector]);
        let needs = node
            .cameras()
            .into_iter()
            .flat_map(|camera| axes.iter().map(move |&axis| Need { camera, axis, map: None }));
        let inboxes =
            node.cameras().into_iter().map(|c| link.inbox(&format!("phase/{}", cell.graph.cameras[c].name)));
        Ok(Self {
            pair,
            projector: node.projector,
            left: node.left,
            matcher: pair_matcher(cell, pair)?,
            needs: needs.collect(),
            inboxes: inboxes.collect::<Result<_>>()?,
            clouds: link.publisher(&format!("cloud/{}", node.name))?,
            text: TextBuffer::new(),
        })
    }

    /// Keeps a phase that the pair needs; those of other projectors are not for it.
    fn keep(&mut self, link: &Link, message: Received<Phase>) -> Result<(), Fault> {
        let header = *message.header();
        if header.projector as usize != self.projector {
            return Ok(());
        }
        let axis = header.info().map_err(|e| lost(&e))?.axis;
        let need = self.needs.iter_mut().find(|n| n.camera == header.camera as usize && n.axis == axis);
        match need {
            Some(need) if need.map.is_none() => {
                need.map = Some(message);
                Ok(())
            }
            Some(_) => {
                let camera = link.cell.graph.camera_name(header.camera as usize);
                Err(Fault::Cycle(format!("a phase of camera \"{camera}\" came twice")))
            }
            None => Ok(()), // an axis that only another pair takes
        }
    }

    fn run(&mut self, link: &mut Link) -> Result<(), Fault> {
        let start_ns = now_ns();
        let mut t_ns = 0;
        let (mut left, mut right) = (Views::default(), Views::default());
        for need in &self.needs {
            let Some(map) = &need.map else { return Ok(()) };
            t_ns = t_ns.max(map.header().t_ns);
            let view = payload::phase(map.header(), map.payload()).map_err(|e| lost(&e))?;
            if need.camera == self.left { left.set(view) } else { right.set(view) }
        }
        let header = Cloud {
            cycle: link.cycle(),
            t_ns,
            pair: self.pair as u32,
            capacity: self.matcher.capacity() as u32,
            points: 0,
        };
        let mut loan = self.clouds.loan(header)?;
        let room = payload::points_mut(loan.payload_mut()).map_err(|e| lost(&e))?;
        let matched = self.matcher.run(&left, &right, room).map_err(|e| lost(&e))?;
        let points = matched.points();
        loan.header_mut().points = points;
        let used = points as usize * size_of::<Point>();
        let output = (used, xxh3_128(&loan.payload()[..used]));
        link.sending(|| loan.send())?;
        self.forget();
        let report = Report { count: points as usize, text: self.text.json(&matched)? };
        link.done_hashed(Work::Match { pair: self.pair }, start_ns, output, report)
    }
}

impl Worker for Matching {
    fn connect(&self) -> Result<(), IpcError> {
        self.inboxes.iter().try_for_each(Inbox::connect)
    }

    fn begin(&mut self, _link: &mut Link) -> Result<(), Fault> {
        self.forget();
        Ok(())
    }

    fn step(&mut self, link: &mut Link) -> Result<bool, Fault> {
        let turn = link.may_start(Work::Match { pair: self.pair });
        for inbox in 0..self.inboxes.len() {
            if let Some(message) = self.inboxes[inbox].take(link)? {
                self.keep(link, message)?;
                return Ok(true);
            }
        }
        let complete = self.needs.iter().all(|need| need.map.is_some());
        if complete && turn {
            self.inboxes.iter().try_for_each(|inbox| inbox.check_not_overtaken(link))?;
            self.run(link)?;
            return Ok(true);
        }
        Ok(false)
    }

    fn forget(&mut self) {
        for need in &mut self.needs {
            need.map = None;
        }
    }
}
