//! Motions from one command to another, among obstacles.
//!
//! A plan is a sequence of commands, to be gone through in straight lines. All along it the robot is in equilibria of one branch:
//! it does not jump. Its discs keep a clearance from obstacles and do not touch each other, and tensions stay within limits.
//!
//! The search is RRT-Connect (Kuffner and LaValle, ICRA 2000) in the box of commands: a tree from the start and one from the goals grow towards
//! each other. Its edges are straight lines along which equilibria are followed in steps that adapt to the room there is: between two
//! equilibria no disc can come nearer than the clearance, by a bound of the way that it takes. Where it moves out of proportion to the command's
//! change the branch ends, and with it the edge. Then corners are cut off by straight lines, those that are left are rounded off by gradient steps on
//! the squares of the way's second differences, and the plan is gone over again in steps eight times as fine, all by the same rules; only
//! where that leads by the same equilibria is it a plan.
//!
//! As nothing is touched, equilibria are those without obstacles, and a base that moves along with the robot changes none of them.

mod error;
pub mod follow_the_leader;
mod goal;
mod planner;
mod search;
mod shorten;
mod smooth;
mod space;
mod surroundings;
mod tree;
mod walk;

pub use error::{Limit, PlanError, Refusal};
pub use planner::{Effort, Goal, MotionPlan, MotionPlanner, PlanSettings, PlanStep};
pub use search::Halts;
pub use space::{Insertion, Stance};
