//! What happens in the cell, numbered and kept for a while, so that a gateway that was away misses nothing.
//!
//! A gateway asks for what came after the last change that it knows. The answer comes at once, or as soon as something happens;
//! nothing waits for the gateway.

use super::command_socket::STOPPED;
use super::protocol::{Answer, Change, StateReport, Watched, What};
use crossbeam::channel::Sender;
use files::result::CycleResult;
use std::collections::VecDeque;

/// Changes that are kept: those of a thousand jobs.
const KEPT: usize = 4096;

/// Features in the results that are kept: some ten megabytes.
const KEPT_FEATURES: usize = 20_000;

/// Changes of one answer: some megabytes of JSON at most.
const PER_ANSWER: usize = 64;

/// Longest wait of a gateway for something to happen, ns. It is below the time-outs of the socket.
const PATIENCE_NS: u64 = 5_000_000_000;

/// A gateway that waits.
struct Watcher {
    after: u64,
    until_ns: u64,
    reply: Sender<Answer>,
}

/// The last changes, and who waits for the next one.
pub(super) struct Changes {
    run: String,
    kept: VecDeque<Change>,
    /// Features in the results that are kept.
    features: usize,
    newest: u64,
    state: Option<StateReport>,
    watchers: Vec<Watcher>,
}

impl Changes {
    /// Of a run that begins.
    pub(super) fn new() -> Self {
        let started: String =
            files::clock::rfc3339_now().chars().filter(char::is_ascii_alphanumeric).collect();
        // Two runs may start within a second.
        let run = format!("{started}-{}", std::process::id());
        Self { run, kept: VecDeque::new(), features: 0, newest: 0, state: None, watchers: Vec::new() }
    }

    /// Notes the state, if it is another one than before.
    pub(super) fn state(&mut self, state: StateReport) {
        if self.state.as_ref() != Some(&state) {
            self.state = Some(state.clone());
            self.add(What::State(state));
        }
    }

    /// Notes a result, without what belongs to the stages.
    pub(super) fn result(&mut self, job: u64, mut result: CycleResult) {
        result.stages.clear();
        result.reports.clear();
        result.elements.clear();
        self.add(What::Result { job, result: Box::new(result) });
    }

    fn add(&mut self, what: What) {
        self.newest += 1;
        self.features += features(&what);
        self.kept.push_back(Change { number: self.newest, what });
        // The newest is kept, however large it is.
        while self.kept.len() > 1 && (self.kept.len() > KEPT || self.features > KEPT_FEATURES) {
            let oldest = self.kept.pop_front();
            self.features -= oldest.map_or(0, |change| features(&change.what));
        }
    }

    /// Answers what came after a change of a run at the next update, or at a later one if it may wait since a time.
    pub(super) fn watch(
        &mut self,
        run: Option<&str>,
        after: u64,
        since_ns: Option<u64>,
        reply: Sender<Answer>,
    ) {
        // Numbers of another run mean nothing here.
        let after = if run == Some(&self.run) { after.min(self.newest) } else { 0 };
        let until_ns = since_ns.map_or(0, |since| since.saturating_add(PATIENCE_NS));
        self.watchers.push(Watcher { after, until_ns, reply });
    }

    /// Answers those for whom there is something, and those who have waited long enough.
    pub(super) fn update(&mut self, now_ns: u64) {
        let newest = self.newest;
        let due = |watcher: &Watcher| watcher.after < newest || watcher.until_ns <= now_ns;
        let (due, waiting) = std::mem::take(&mut self.watchers).into_iter().partition(due);
        self.watchers = waiting;
        for watcher in due {
            // The gateway may have disconnected.
            let _ = watcher.reply.send(self.answer(watcher.after));
        }
    }

    /// Answers those who still wait when the run ends.
    pub(super) fn close(&mut self) {
        for watcher in std::mem::take(&mut self.watchers) {
            let _ = watcher.reply.send(Answer::Refused(STOPPED.into()));
        }
    }

    fn answer(&self, after: u64) -> Answer {
        let oldest = self.kept.front().map_or(1, |change| change.number);
        let known = (after + 1).saturating_sub(oldest) as usize;
        let changes = self.kept.iter().skip(known).take(PER_ANSWER).cloned().collect();
        Answer::Watched(Box::new(Watched { run: self.run.clone(), oldest, newest: self.newest, changes }))
    }
}

fn features(what: &What) -> usize {
    match what {
        What::State(_) => 0,
        What::Result { result, .. } => result.features.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossbeam::channel::{Receiver, bounded};

    fn watch(changes: &mut Changes, run: Option<&str>, after: u64) -> Receiver<Answer> {
        let (reply, answer) = bounded(1);
        changes.watch(run, after, Some(0), reply);
        answer
    }

    fn numbers(answer: &Receiver<Answer>) -> Option<(u64, Vec<u64>)> {
        match answer.try_recv().ok()? {
            Answer::Watched(watched) => {
                Some((watched.oldest, watched.changes.iter().map(|change| change.number).collect()))
            }
            other => panic!("{other:?}"),
        }
    }

    fn with_results(count: u64) -> Changes {
        let mut changes = Changes::new();
        for number in 1..=count {
            changes.result(number, CycleResult { number, ..CycleResult::default() });
        }
        changes
    }

    #[test]
    fn who_knows_less_is_answered_at_once_and_who_knows_all_when_something_comes() {
        let mut changes = with_results(3);
        let run = changes.run.clone();
        let (behind, current) = (watch(&mut changes, Some(&run), 1), watch(&mut changes, Some(&run), 3));
        changes.update(1);
        assert_eq!(numbers(&behind), Some((1, vec![2, 3])));
        assert_eq!(numbers(&current), None);
        changes.result(4, CycleResult::default());
        changes.update(2);
        assert_eq!(numbers(&current), Some((1, vec![4])));
    }

    #[test]
    fn who_waits_in_vain_is_answered_with_nothing_new() {
        let mut changes = with_results(1);
        let run = changes.run.clone();
        let answer = watch(&mut changes, Some(&run), 1);
        changes.update(PATIENCE_NS - 1);
        assert_eq!(numbers(&answer), None);
        changes.update(PATIENCE_NS);
        assert_eq!(numbers(&answer), Some((1, vec![])));
    }

    /// Proves: who does not wait learns of a state that was reported after the request and before the update.
    #[test]
    fn who_does_not_wait_is_answered_at_the_next_update() {
        let mut changes = with_results(1);
        let run = changes.run.clone();
        let ask = |changes: &mut Changes| {
            let (reply, answer) = bounded(1);
            changes.watch(Some(&run), 1, None, reply);
            answer
        };
        let answer = ask(&mut changes);
        changes.update(1);
        assert_eq!(numbers(&answer), Some((1, vec![])));
        let answer = ask(&mut changes);
        changes.result(2, CycleResult::default());
        changes.update(1);
        assert_eq!(numbers(&answer), Some((1, vec![2])));
    }

    #[test]
    fn numbers_of_another_run_count_for_nothing() {
        let mut changes = with_results(2);
        for run in [None, Some("another")] {
            let answer = watch(&mut changes, run, 2);
            changes.update(1);
            assert_eq!(numbers(&answer), Some((1, vec![1, 2])));
        }
    }

    #[test]
    fn a_gap_is_told_and_long_answers_come_in_pieces() {
        let count = KEPT as u64 + 10;
        let mut changes = with_results(count);
        let run = changes.run.clone();
        let (mut after, mut seen) = (0, Vec::new());
        while after < count {
            let answer = watch(&mut changes, Some(&run), after);
            changes.update(1);
            let (oldest, numbers) = numbers(&answer).unwrap();
            assert_eq!(oldest, 11);
            assert!(numbers.len() <= PER_ANSWER);
            seen.extend(numbers);
            after = *seen.last().unwrap();
        }
        assert_eq!(seen, (11..=count).collect::<Vec<_>>());
    }
}
