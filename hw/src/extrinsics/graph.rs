//! Which cameras see the board in which views, and first poses along the surest sightings.

use nalgebra::Isometry3;

/// A camera that sees the board in a view.
#[derive(Clone, Debug)]
pub(super) struct Link {
    pub camera: usize,
    pub view: usize,
    /// Pose of the board in the camera's frame (m).
    pub pose: Isometry3<f64>,
    /// How unsure that is: variances add up along a chain.
    pub variance: f64,
}

impl Link {
    /// A link that says only that there is one.
    pub fn between(camera: usize, view: usize) -> Self {
        Self {
            camera,
            view,
            pose: Isometry3::identity(),
            variance: 0.0,
        }
    }
}

/// A camera, or the board in a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Node {
    Camera(usize),
    View(usize),
}

/// Poses by number, in one frame (m); `None` of what nothing relates to it.
pub(super) struct Reached {
    pub cameras: Vec<Option<Isometry3<f64>>>,
    pub views: Vec<Option<Isometry3<f64>>>,
}

/// Cameras and views, and the links between them.
pub(super) struct Graph<'a> {
    cameras: usize,
    views: usize,
    links: &'a [Link],
}

impl<'a> Graph<'a> {
    pub fn new(cameras: usize, views: usize, links: &'a [Link]) -> Self {
        Self {
            cameras,
            views,
            links,
        }
    }

    /// Whether a camera sees the board in no view.
    pub fn is_blind(&self, camera: usize) -> bool {
        !self.links.iter().any(|link| link.camera == camera)
    }

    /// Whether no camera sees the board in a view.
    pub fn is_unseen(&self, view: usize) -> bool {
        !self.links.iter().any(|link| link.view == view)
    }

    /// Poses of all that links relate to `origin`, whose pose is given, each along the chain of the least variance (Dijkstra's
    /// algorithm).
    pub fn chain(&self, origin: Node, pose: Isometry3<f64>) -> Reached {
        let mut around: Vec<Vec<&Link>> = vec![Vec::new(); self.cameras + self.views];
        for link in self.links {
            around[link.camera].push(link);
            around[self.cameras + link.view].push(link);
        }
        let number = |node: Node| match node {
            Node::Camera(camera) => camera,
            Node::View(view) => self.cameras + view,
        };
        let mut variances = vec![f64::INFINITY; around.len()];
        let mut poses = vec![None; around.len()];
        let mut done = vec![false; around.len()];
        variances[number(origin)] = 0.0;
        poses[number(origin)] = Some(pose);
        // A linear search for the nearest: there are tens of cameras and views.
        loop {
            let open = (0..around.len()).filter(|&k| !done[k] && poses[k].is_some());
            let nearest = open.min_by(|&a, &b| variances[a].total_cmp(&variances[b]));
            let Some(at) = nearest else { break };
            let Some(pose): Option<Isometry3<f64>> = poses[at] else {
                break;
            };
            done[at] = true;
            for link in &around[at] {
                let (other, reached) = match at < self.cameras {
                    true => (self.cameras + link.view, pose * link.pose),
                    false => (link.camera, pose * link.pose.inverse()),
                };
                let variance = variances[at] + link.variance;
                if !done[other] && variance < variances[other] {
                    variances[other] = variance;
                    poses[other] = Some(reached);
                }
            }
        }
        let views = poses.split_off(self.cameras);
        Reached {
            cameras: poses,
            views,
        }
    }

    /// The cameras, in groups that links relate.
    pub fn groups(&self) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for camera in 0..self.cameras {
            if groups.iter().any(|group| group.contains(&camera)) {
                continue;
            }
            let reached = self.chain(Node::Camera(camera), Isometry3::identity());
            let group = (0..self.cameras).filter(|&other| reached.cameras[other].is_some());
            groups.push(group.collect());
        }
        groups
    }
}
