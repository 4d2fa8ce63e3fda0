//! Which triangles of a mesh share a vertex or an edge.

use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};

use hashbrown::HashMap;
use parry3d_f64::math::Vec3;

/// The triangles around each vertex of a mesh, vertices at one position taken as one: files of triangles (STL) repeat them.
#[derive(Clone, Debug)]
pub(crate) struct Adjacency {
    /// Of each triangle its vertices: of those at one position the first.
    triangles: Vec<[u32; 3]>,
    /// `rings[starts[v]..starts[v + 1]]` are the triangles around vertex v.
    starts: Vec<u32>,
    rings: Vec<u32>,
    /// Whether the triangles are oriented alike and leave no edge open.
    pub closed: bool,
}

impl Adjacency {
    /// Of triangles by the numbers of their vertices, whose positions are finite.
    pub fn new(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let first = firsts(vertices);
        let triangles: Vec<[u32; 3]> = (triangles.iter())
            .map(|corners| corners.map(|vertex| first[vertex as usize]))
            .collect();
        // Counts, then ends of the rings, which move to their starts as the rings are filled from behind.
        let mut starts = vec![0_u32; vertices.len() + 1];
        for &vertex in triangles.as_flattened() {
            starts[vertex as usize] += 1;
        }
        let mut end = 0;
        for start in &mut starts {
            end += *start;
            *start = end;
        }
        let mut rings = vec![0_u32; 3 * triangles.len()];
        for (triangle, corners) in triangles.iter().enumerate().rev() {
            for &vertex in corners {
                let place = &mut starts[vertex as usize];
                *place -= 1;
                rings[*place as usize] = triangle as u32;
            }
        }
        let closed = is_closed(&triangles);
        Self {
            triangles,
            starts,
            rings,
            closed,
        }
    }

    /// The vertex at a corner of a triangle.
    pub fn vertex(&self, triangle: u32, corner: usize) -> u32 {
        self.triangles[triangle as usize][corner]
    }

    /// The edge from a corner of a triangle to the next: its vertices, the lower number first.
    pub fn edge(&self, triangle: u32, corner: usize) -> [u32; 2] {
        let corners = self.triangles[triangle as usize];
        let (from, to) = (corners[corner], corners[(corner + 1) % 3]);
        [from.min(to), from.max(to)]
    }

    /// The triangles around a vertex.
    pub fn around_vertex(&self, vertex: u32) -> &[u32] {
        let vertex = vertex as usize;
        &self.rings[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }

    /// The triangles that share an edge.
    pub fn around_edge(&self, [from, to]: [u32; 2]) -> impl Iterator<Item = u32> {
        let rings = [(from, to), (to, from)].map(|(at, other)| (self.around_vertex(at), other));
        let (ring, other) = match rings[0].0.len() <= rings[1].0.len() {
            true => rings[0],
            false => rings[1],
        };
        let has = move |&triangle: &u32| self.triangles[triangle as usize].contains(&other);
        ring.iter().copied().filter(has)
    }
}

/// Of each vertex the first one at its position.
fn firsts(vertices: &[Vec3]) -> Vec<u32> {
    let mut known: HashMap<[u64; 3], u32> = HashMap::with_capacity(vertices.len());
    // Of the two zeros the one without a sign.
    let key = |vertex: &Vec3| vertex.to_array().map(|x| (x + 0.0).to_bits());
    (vertices.iter().enumerate())
        .map(|(number, vertex)| *known.entry(key(vertex)).or_insert(number as u32))
        .collect()
}

/// Whether every edge is passed as often in one direction as in the other: the sum of a number that belongs to each edge, by
/// direction, is then 0, and for others by chance only (once in 2^64).
fn is_closed(triangles: &[[u32; 3]]) -> bool {
    let hasher = BuildHasherDefault::<DefaultHasher>::default();
    let mut sum = 0_u64;
    for corners in triangles {
        for k in 0..3 {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let number = hasher.hash_one([from.min(to), from.max(to)]);
            match from.cmp(&to) {
                std::cmp::Ordering::Less => sum = sum.wrapping_add(number),
                std::cmp::Ordering::Greater => sum = sum.wrapping_sub(number),
                std::cmp::Ordering::Equal => {}
            }
        }
    }
    sum == 0
}
