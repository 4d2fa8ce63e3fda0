//! How many random queries are solved, and whether the plans hold.

use tdcr_control::plan::{Goal, MotionPlan, MotionPlanner, PlanError, PlanSettings};
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::robot::{Loads, Robot};

use crate::check::{check, farthest, gap, sharpest_corner};
use crate::random::{CLEARANCE, Query, query};

/// What ends a search.
#[derive(Clone, Copy)]
enum Budget {
    Nodes(usize),
    /// Of a processor (s).
    Seconds(f64),
}

/// Plans queries of a robot; the share that is solved within the budget, and the plans' sharpest corners in the mean (rad).
fn solved(name: &str, queries: std::ops::Range<u64>, budget: Budget) -> [f64; 2] {
    let robot = Robot::load(name).unwrap();
    let count = queries.end - queries.start;
    let (mut times, mut steps, mut settled) = (Vec::new(), 0, 0);
    let (mut reasons, mut corners) = (Vec::new(), 0.0);
    let settings = PlanSettings {
        clearance: CLEARANCE,
        seconds: 1e6,
        nodes: match budget {
            Budget::Nodes(nodes) => nodes,
            Budget::Seconds(_) => usize::MAX,
        },
        ..PlanSettings::default()
    };
    for index in queries {
        let query = query(&robot, index);
        let mut planner =
            MotionPlanner::new(&robot, &query.scene, &Loads::default(), settings).unwrap();
        let began = processor_seconds();
        let go_on = |_| match budget {
            Budget::Nodes(_) => true,
            Budget::Seconds(most) => processor_seconds() - began < most,
        };
        let goal = Goal::Stance(query.to.clone().into());
        match planner.plan_while(&query.from.clone().into(), &goal, go_on) {
            Ok(plan) => {
                times.push(processor_seconds() - began);
                settled += plan.effort.settled;
                steps += plan.steps.len();
                corners += sharpest_corner(&robot, &plan);
                assert_holds(&robot, &query, &plan, &format!("{name} {index}"));
            }
            Err(error @ (PlanError::NotFound { .. } | PlanError::Interrupted)) => {
                reasons.push(format!("\n  {index}: {error}"));
            }
            Err(error) => panic!("{name} {index}: {error}"),
        }
    }
    let corner = corners / times.len() as f64;
    times.sort_by(f64::total_cmp);
    let quantile = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    eprintln!(
        "{name}: {} of {count}; seconds {:.3} median, {:.3} of 90 %, {:.3} at most; {:.1} us for each of {settled} equilibria; {} \
         steps, sharpest corner {:.1} degrees in the mean{}",
        times.len(),
        quantile(0.5),
        quantile(0.9),
        quantile(1.0),
        1e6 * times.iter().sum::<f64>() / settled as f64,
        steps / times.len(),
        corner.to_degrees(),
        reasons.concat()
    );
    [times.len() as f64 / count as f64, corner]
}

fn assert_holds(robot: &Robot, query: &Query, plan: &MotionPlan, which: &str) {
    let length = *robot.arc_lengths().last().unwrap();
    let checked = check(robot, &query.scene, plan);
    assert!(checked.converged, "{which}");
    assert!(checked.clearance >= CLEARANCE, "{which}: {checked:?}");
    assert!(checked.steepest <= 10.0 * length, "{which}: {checked:?}");
    assert!(checked.off <= 1e-5, "{which}: {checked:?}");
    for step in &plan.steps {
        let (places, turns) = step.configuration.place(robot);
        let away = gap(robot, &query.scene, &places, &turns);
        assert!((away - step.clearance.unwrap()).abs() <= 1e-9, "{which}");
    }
    let ends = [&plan.steps[0], &plan.steps[plan.steps.len() - 1]];
    let commands = ends.map(|step| &step.stance.command);
    assert_eq!(commands, [&query.from, &query.to], "{which}");
}

#[test]
fn robots_that_may_touch_obstacles_and_themselves_settle_where_plans_have_them() {
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).unwrap();
        let query = query(&robot, 0);
        let settings = PlanSettings::default();
        let mut planner =
            MotionPlanner::new(&robot, &query.scene, &Loads::default(), settings).unwrap();
        let goal = Goal::Stance(query.to.clone().into());
        let plan = planner.plan(&query.from.clone().into(), &goal).unwrap();
        let mut settler = ContactSettler::new(&robot, &query.scene);
        for step in &plan.steps {
            let settled = settler
                .follow(&step.stance.command, &Loads::default())
                .unwrap();
            assert!(
                settled.equilibrium.converged && settled.contacts.is_empty(),
                "{name}"
            );
            let off = farthest(&settled.equilibrium.positions, &step.positions);
            assert!(off <= 1e-5, "{name}: {off} m off");
        }
    }
}

/// Time that this thread has had a processor for (s): other work on the machine does not count.
fn processor_seconds() -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    told.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9
}

#[test]
fn most_random_queries_are_solved_and_their_plans_hold_in_steps_ten_times_as_fine() {
    for name in ["2m", "3m", "5m"] {
        let [share, corner] = solved(name, 0..12, Budget::Nodes(300));
        assert!(share >= 0.9, "{name}");
        assert!(corner.to_degrees() < 3.0, "{name}: corners are rounded off");
    }
}

/// `cargo test --release -p tdcr-control --test plan -- --ignored --nocapture`: minutes.
#[test]
#[ignore = "takes minutes"]
fn of_a_thousand_random_queries_95_percent_are_solved_within_two_seconds_of_a_processor() {
    let count = std::env::var("QUERIES").map_or(1000, |count| count.parse().unwrap());
    for name in ["2m", "3m", "5m"] {
        let [share, _] = solved(name, 0..count, Budget::Seconds(2.0));
        assert!(share >= 0.95, "{name}");
    }
}
