//! Which rank-one terms the potential's Hessian has, and where along the chain they act.
//!
//! A tendon's energy `U(L(q))` has the Hessian `U'' dL dL'` besides that of its length: one column
//! `dL` of weight `U''`. A piece of tendon that passes discs by turns as a whole, which costs two
//! columns more: those of the directions across it. Each column has a slot at every joint that it
//! acts on; columns that share no joint share slots.

use crate::robot::{Robot, joints_along};

/// The columns of one robot.
#[derive(Clone, Debug)]
pub(crate) struct Columns {
    /// Slots at every joint.
    pub slots: usize,
    /// Slot of each column: of every tendon, then two of every span.
    pub slot: Vec<usize>,
    /// Columns whose highest joint this is.
    pub top: Vec<Vec<usize>>,
    /// Columns whose lowest joint this is.
    pub bottom: Vec<Vec<usize>>,
}

impl Columns {
    pub fn new(robot: &Robot) -> Self {
        let joints = robot.discs().len();
        let tendons = robot
            .tendons()
            .iter()
            .map(|tendon| joints_along(&tendon.route));
        let spans = robot
            .spans()
            .iter()
            .flat_map(|span| [0..span.upper + 1, 0..span.upper + 1]);
        let reaches: Vec<_> = tendons.chain(spans).collect();
        let mut columns = Self {
            slots: 0,
            slot: vec![0; reaches.len()],
            top: vec![Vec::new(); joints],
            bottom: vec![Vec::new(); joints],
        };
        // Interval colouring: by lowest joint, the first slot that is free there. No colouring takes fewer
        // slots (Kleinberg and Tardos, Algorithm Design, 2005, ch. 4.1).
        let mut order: Vec<usize> = (0..reaches.len())
            .filter(|&c| !reaches[c].is_empty())
            .collect();
        order.sort_by_key(|&column| reaches[column].start);
        let mut free_from: Vec<usize> = Vec::new();
        for column in order {
            let reach = &reaches[column];
            let free = free_from.iter().position(|&joint| joint <= reach.start);
            let slot = free.unwrap_or(free_from.len());
            if slot == free_from.len() {
                free_from.push(0);
            }
            free_from[slot] = reach.end;
            columns.slot[column] = slot;
            columns.bottom[reach.start].push(column);
            columns.top[reach.end - 1].push(column);
        }
        columns.slots = free_from.len();
        columns
    }
}
