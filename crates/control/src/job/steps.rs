//! The steps of a job as its operator lives through them: what is set up, whose turn it was for how long, what is still to
//! come, and which of them may be asked for again.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Iteration, TimeSpent};
use bench::device::Setup;

/// What the operator is asked to do, in the order of the job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlannedStep {
    /// The step's name, as the job asks for it.
    pub name: String,
    /// The value to be set, with its unit; null where there is none.
    pub value: Option<String>,
    /// What is set up.
    pub setup: Setup,
}

/// Where a step is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StepState {
    /// Done.
    Done,
    /// Under way; of a job that has ended, what it was at then.
    Now,
    /// Still to come, as far as can be told.
    Next,
    /// Another has taken its place, as it was asked for again: what came of it counts no more.
    Repeated,
}

/// A step of a job: something is set up, and the bench works with it until the next is asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobStep {
    /// `preparation` (devices are read, and axes homed where it is needed), `homing`, `measuring`, or the name of the
    /// operator's step that it begins with, e.g. `white_frame`.
    pub name: String,
    /// The value to be set, with its unit; `null` where there is none.
    pub value: Option<String>,
    /// What is set up; `null` where nothing is.
    pub setup: Option<Setup>,
    /// Where it is.
    pub state: StepState,
    /// Number of the operator's step that it begins with; `null` where it begins with none, or is still to come.
    pub number: Option<u32>,
    /// Number of the earlier step that it takes the place of.
    pub repeats: Option<u32>,
    /// Why the job itself asks for that step again, in words.
    #[serde(default)]
    pub because: Option<String>,
    /// When it began, RFC 3339; `null` where it is still to come.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub began_at: Option<Timestamp>,
    /// How long the operator took for it, s; `null` until it is over.
    pub operator_s: Option<f64>,
    /// How long the bench worked on it, s; `null` until it is over.
    pub bench_s: Option<f64>,
}

/// What of an alignment can be done again before the shell is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Repeatable {
    /// The white frame, and with it all that was measured by it.
    WhiteFrame,
    /// The triple-level board in air, and with it the air step.
    Levels,
    /// A flat board in air, and with it the air step.
    FlatBoard,
}

/// Name of the step that sets the aperture, which belongs to the air step.
const APERTURE: &str = "aperture";

impl Repeatable {
    /// What a step of this name is; `None` where it cannot be done again.
    pub(crate) fn of(name: &str) -> Option<Self> {
        match name {
            "white_frame" => Some(Self::WhiteFrame),
            "triple_board_in_air" => Some(Self::Levels),
            "board_in_air" => Some(Self::FlatBoard),
            _ => None,
        }
    }
}

impl JobStep {
    /// One that has not begun.
    fn next(planned: PlannedStep) -> Self {
        let PlannedStep { name, value, setup } = planned;
        Self { setup: Some(setup), state: StepState::Next, ..Self::begun(&name, value) }
    }

    fn begun(name: &str, value: Option<String>) -> Self {
        Self {
            name: name.to_owned(),
            value,
            setup: None,
            state: StepState::Now,
            number: None,
            repeats: None,
            because: None,
            began_at: None,
            operator_s: None,
            bench_s: None,
        }
    }

    /// One that the bench does by itself.
    pub(crate) fn of_bench(name: &str) -> Self {
        Self::begun(name, None)
    }

    /// One that begins with an operator's step.
    pub(crate) fn asked(number: u32, name: &str, value: Option<String>, setup: &Setup) -> Self {
        Self { number: Some(number), setup: Some(setup.clone()), ..Self::begun(name, value) }
    }

    fn is_like(&self, other: &Self) -> bool {
        self.name == other.name && self.value == other.value
    }
}

/// Takes in what is planned.
pub(crate) fn expect(steps: &mut Vec<JobStep>, planned: Vec<PlannedStep>) {
    steps.retain(|step| step.state != StepState::Next);
    steps.extend(planned.into_iter().map(JobStep::next));
}

/// Other boards than was planned are put up in air: what is still to come there.
pub(crate) fn change_boards(steps: &mut Vec<JobStep>, in_air: Vec<PlannedStep>, aperture_set: bool) {
    let from = steps.iter().take_while(|step| step.state != StepState::Next).count();
    let is_in_air = |step: &&JobStep| step.name == APERTURE || Repeatable::of(&step.name).is_some();
    let planned = steps[from..].iter().take_while(is_in_air).count();
    let in_air = in_air.into_iter().filter(|step| step.name != APERTURE || !aperture_set);
    steps.splice(from..from + planned, in_air.map(JobStep::next));
}

/// A step begins, where the one before has come to its end. What was planned before it is not needed after all, unless it is
/// one before once more.
pub(crate) fn begin(steps: &mut Vec<JobStep>, step: JobStep, spent: &TimeSpent) {
    end(steps, spent);
    let here = steps.iter().take_while(|step| step.state != StepState::Next).count();
    if step.because.is_some() {
        for before in steps.iter_mut().filter(|before| before.number.is_some() && before.number == step.repeats) {
            before.state = StepState::Repeated;
        }
    } else if let Some(place) = planned(&steps[..here], &steps[here..], &step) {
        steps.drain(here..=here + place);
    }
    steps.insert(here, JobStep { state: StepState::Now, began_at: Some(Timestamp::now()), ..step });
}

/// Where a step is among the `next` ones, after those `past`.
fn planned(past: &[JobStep], next: &[JobStep], step: &JobStep) -> Option<usize> {
    let expected = next.iter().position(|next| next.is_like(step));
    // One of that name whose value has turned out otherwise, unless this is another one in between.
    expected.or_else(|| {
        let known = past.iter().any(|past| past.is_like(step) && past.state == StepState::Done);
        next.first().filter(|next| !known && next.name == step.name).map(|_| 0)
    })
}

/// The step under way is done; it took what was `spent` since it began.
pub(crate) fn end(steps: &mut [JobStep], spent: &TimeSpent) {
    for step in steps.iter_mut().filter(|step| step.state == StepState::Now) {
        step.state = StepState::Done;
        (step.operator_s, step.bench_s) = (Some(spent.operator_s), Some(spent.total_s - spent.operator_s));
    }
}

/// The numbers of the operator's steps, from `from` on, that can be asked for again while one of this name waits: the last
/// white frame and the last board. Nothing while a white frame is waited for, which goes before both.
pub(crate) fn repeatable(steps: &[JobStep], from: u32, waiting: &str) -> Vec<u32> {
    if Repeatable::of(waiting) == Some(Repeatable::WhiteFrame) {
        return Vec::new();
    }
    let last = |white| {
        let mut done = steps.iter().filter(|step| step.state == StepState::Done && step.number >= Some(from));
        done.rfind(|step| Repeatable::of(&step.name).is_some_and(|what| (what == Repeatable::WhiteFrame) == white))?
            .number
    };
    [true, false].into_iter().filter_map(last).collect()
}

/// The operator's step `number` is asked for again: it and what depends on it is still to come, and so is what waits now.
pub(crate) fn repeat(steps: &mut Vec<JobStep>, number: u32, spent: &TimeSpent) {
    let waiting = steps.iter().position(|step| step.state == StepState::Now);
    end(steps, spent);
    let mut again = Vec::new();
    for (place, step) in steps.iter_mut().enumerate() {
        let depends = step.number >= Some(number) && Repeatable::of(&step.name).is_some();
        if step.state == StepState::Done && (depends || Some(place) == waiting) {
            step.state = StepState::Repeated;
            again.push(JobStep {
                state: StepState::Next,
                number: None,
                repeats: None,
                because: None,
                began_at: None,
                operator_s: None,
                bench_s: None,
                ..step.clone()
            });
        }
    }
    let here = steps.iter().take_while(|step| step.state != StepState::Next).count();
    steps.splice(here..here, again);
}

/// Marks what counts no more: what was measured after a step had begun, and before another began that repeats it. Where the
/// job itself asks for a step again, of which nothing could be seen, what it had measured before counts.
pub(crate) fn discard(iterations: &mut [Iteration], steps: &[JobStep]) {
    for iteration in iterations {
        let at = Some(iteration.at);
        let began_before = |number| steps.iter().any(|step| step.number == Some(number) && step.began_at <= at);
        let repeats = |step: &JobStep| step.repeats.filter(|_| step.because.is_none()).is_some_and(began_before);
        iteration.discarded = steps.iter().any(|step| step.began_at > at && repeats(step));
    }
}

/// The job is over; what was planned and did not come was not needed where it has come to its `good` end.
pub(crate) fn close(steps: &mut Vec<JobStep>, good: bool, spent: &TimeSpent) {
    if good {
        end(steps, spent);
        steps.retain(|step| step.state != StepState::Next);
    } else {
        for step in steps.iter_mut().filter(|step| step.state == StepState::Now) {
            (step.operator_s, step.bench_s) = (Some(spent.operator_s), Some(spent.total_s - spent.operator_s));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spent(operator_s: f64, total_s: f64) -> TimeSpent {
        TimeSpent {
            total_s,
            operator_s,
            motion_s: 0.0,
            settling_s: 0.0,
            frames_s: 0.0,
            measuring_s: 0.0,
            other_s: total_s - operator_s,
        }
    }

    fn planned(name: &str, value: &str) -> PlannedStep {
        let value = (!value.is_empty()).then(|| value.to_owned());
        PlannedStep { name: name.to_owned(), value, setup: Setup::Diffuser }
    }

    fn ask(steps: &mut Vec<JobStep>, number: u32, name: &str, value: &str) {
        let value = (!value.is_empty()).then(|| value.to_owned());
        begin(steps, JobStep::asked(number, name, value, &Setup::Diffuser), &spent(2.0, 5.0));
    }

    fn told(steps: &[JobStep]) -> String {
        let one = |step: &JobStep| {
            let state = match step.state {
                StepState::Done => "",
                StepState::Now => "*",
                StepState::Next => "?",
                StepState::Repeated => "-",
            };
            format!("{state}{}{}", step.name, step.value.as_deref().unwrap_or_default())
        };
        steps.iter().map(one).collect::<Vec<_>>().join(" ")
    }

    fn alignment() -> Vec<JobStep> {
        let mut steps = Vec::new();
        let plan =
            [("white_frame", ""), ("board_in_air", "A"), ("board_in_air", "B"), ("aperture", "f"), ("shell", "")];
        expect(&mut steps, plan.map(|(name, value)| planned(name, value)).to_vec());
        begin(&mut steps, JobStep::of_bench("preparation"), &spent(0.0, 0.0));
        steps
    }

    #[test]
    fn what_comes_as_planned_takes_its_place_and_what_does_not_is_put_in_or_left_out() {
        let mut steps = alignment();
        ask(&mut steps, 1, "white_frame", "");
        assert_eq!(told(&steps), "preparation *white_frame ?board_in_airA ?board_in_airB ?aperturef ?shell");
        assert_eq!((steps[0].operator_s, steps[0].bench_s), (Some(2.0), Some(3.0)));
        // At another place than planned.
        ask(&mut steps, 2, "board_in_air", "C");
        assert_eq!(told(&steps), "preparation white_frame *board_in_airC ?board_in_airB ?aperturef ?shell");
        // The second board is not needed; the same once more is none of those planned.
        ask(&mut steps, 3, "aperture", "f");
        ask(&mut steps, 4, "white_frame", "");
        ask(&mut steps, 5, "board_in_air", "C");
        let now = "preparation white_frame board_in_airC aperturef white_frame *board_in_airC ?shell";
        assert_eq!(told(&steps), now);
        let mut failed = steps.clone();
        close(&mut failed, false, &spent(1.0, 1.0));
        assert_eq!((told(&failed).as_str(), failed[5].bench_s), (now, Some(0.0)));
        close(&mut steps, true, &spent(1.0, 1.0));
        assert_eq!(told(&steps), "preparation white_frame board_in_airC aperturef white_frame board_in_airC");
    }

    #[test]
    fn what_the_job_asks_for_once_more_leaves_what_is_planned() {
        let mut steps = Vec::new();
        let plan = [("white_frame", ""), ("board_in_air", "A"), ("white_frame", ""), ("shell", "")];
        expect(&mut steps, plan.map(|(name, value)| planned(name, value)).to_vec());
        ask(&mut steps, 1, "white_frame", "");
        let again = JobStep {
            repeats: Some(1),
            because: Some("It was dark.".to_owned()),
            ..JobStep::asked(2, "white_frame", None, &Setup::Diffuser)
        };
        begin(&mut steps, again, &spent(2.0, 5.0));
        assert_eq!(told(&steps), "-white_frame *white_frame ?board_in_airA ?white_frame ?shell");
        ask(&mut steps, 3, "board_in_air", "A");
        assert_eq!(told(&steps), "-white_frame white_frame *board_in_airA ?white_frame ?shell");
    }

    #[test]
    fn the_last_board_and_the_last_white_frame_are_asked_for_again_with_what_depends_on_them() {
        let mut steps = alignment();
        ask(&mut steps, 1, "white_frame", "");
        assert_eq!(repeatable(&steps, 1, "white_frame"), [] as [u32; 0]);
        ask(&mut steps, 2, "board_in_air", "A");
        assert_eq!(repeatable(&steps, 1, "board_in_air"), [1]);
        ask(&mut steps, 3, "aperture", "f");
        assert_eq!(repeatable(&steps, 1, "aperture"), [1, 2]);
        assert_eq!(repeatable(&steps, 2, "aperture"), [2], "what came before is no part of it");
        let mut board = steps.clone();
        repeat(&mut board, 2, &spent(1.0, 1.0));
        assert_eq!(told(&board), "preparation white_frame -board_in_airA -aperturef ?board_in_airA ?aperturef ?shell");
        assert_eq!(repeatable(&board, 1, "shell"), [1], "what is to be done again is not there to be repeated");
        ask(&mut board, 4, "board_in_air", "A");
        assert_eq!((board[4].number, board[4].state), (Some(4), StepState::Now));
        repeat(&mut steps, 1, &spent(1.0, 1.0));
        assert!(
            told(&steps).starts_with("preparation -white_frame -board_in_airA -aperturef ?white_frame ?board_in_airA")
        );
    }
}
