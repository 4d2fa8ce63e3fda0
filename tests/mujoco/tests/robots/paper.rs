//! The paper's simulated robots as MuJoCo models, written from the paper's numbers alone.

/// Tendon holes of the base and of every disc: x, y (m).
const HOLES: [[f64; 2]; 3] = [[0.0125, 0.0], [-0.00625, 0.010825], [-0.00625, -0.010825]];
const DISCS_PER_MODULE: usize = 5;

struct Numbers {
    modules: usize,
    half_height: f64,
    pitch: f64,
    gain: f64,
    /// Density of a disc by its index (kg/m3).
    density: fn(usize) -> f64,
}

impl Numbers {
    fn of(robot: &str) -> Self {
        let (modules, half_height, pitch, gain) = match robot {
            "2m" => (2, 0.0085, 0.017, 500.0),
            "3m" => (3, 0.0080, 0.016, 500.0),
            "5m" => (5, 0.0080, 0.016, 700.0),
            other => panic!("the paper has no robot {other}"),
        };
        let density = match robot {
            "5m" => |disc| 25.0 - disc as f64 * 25.0 / 30.0,
            _ => |_| 25.0,
        };
        Self {
            modules,
            half_height,
            pitch,
            gain,
            density,
        }
    }
}

/// MJCF text of a robot: discs `disc0`, `disc1`, ... on ball joints, spatial tendons and position
/// actuators module by module.
pub fn mjcf(robot: &str) -> String {
    let numbers = Numbers::of(robot);
    let base = sites("base", -0.0085);
    let discs: String = (0..DISCS_PER_MODULE * numbers.modules)
        .map(|index| disc(&numbers, index))
        .collect();
    let ends = "</body>".repeat(DISCS_PER_MODULE * numbers.modules);
    let (mut tendons, mut actuators) = (String::new(), String::new());
    for module in 0..numbers.modules {
        for hole in 0..HOLES.len() {
            tendons += &tendon(module, hole);
            actuators += &format!(
                "<position tendon='tendon{module}_{hole}' kp='{}' ctrllimited='true' ctrlrange='0 0.04'/>",
                numbers.gain
            );
        }
    }
    format!(
        "<mujoco><option timestep='0.002' gravity='0 0 -9.81'/>
         <worldbody><body name='base' pos='0 0 0.174'>{base}{discs}{ends}</body></worldbody>
         <tendon>{tendons}</tendon><actuator>{actuators}</actuator></mujoco>"
    )
}

/// A disc, its element left open for the next one.
fn disc(numbers: &Numbers, index: usize) -> String {
    let offset = if index == 0 { 0.00895 } else { numbers.pitch };
    let (half_height, density) = (numbers.half_height, (numbers.density)(index));
    let name = format!("disc{index}");
    format!(
        "<body name='{name}' pos='0 0 {offset}'>
         <joint type='ball' damping='0.1' armature='0.01'/>
         <geom type='cylinder' size='0.02 {half_height}' density='{density}'
               contype='0' conaffinity='0'/>{}",
        sites(&name, 0.0)
    )
}

/// The tendon holes of a body, at a height in its frame (m).
fn sites(body: &str, height: f64) -> String {
    let site = |(hole, [x, y]): (usize, &[f64; 2])| {
        format!("<site name='{body}_{hole}' pos='{x} {y} {height}'/>")
    };
    HOLES.iter().enumerate().map(site).collect()
}

/// A tendon from the top of the module below, or the base, to the top of its own module.
fn tendon(module: usize, hole: usize) -> String {
    let first = DISCS_PER_MODULE * module;
    let below = first
        .checked_sub(1)
        .map_or("base".to_owned(), |disc| format!("disc{disc}"));
    let discs = (first..first + DISCS_PER_MODULE).map(|disc| format!("disc{disc}"));
    let sites: String = std::iter::once(below)
        .chain(discs)
        .map(|body| format!("<site site='{body}_{hole}'/>"))
        .collect();
    format!("<spatial name='tendon{module}_{hole}'>{sites}</spatial>")
}
