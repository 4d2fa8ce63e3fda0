//! What is drawn in a plot: lines, dots, bands, bars.

/// Points drawn alike. A point without a place on an axis is left out, and leaves a gap in a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Name in the legend; none where it is empty.
    pub name: String,
    /// How they are drawn.
    pub shape: Shape,
    /// Their colour.
    pub ink: Ink,
    /// Horizontal and vertical coordinates.
    pub points: Vec<[f64; 2]>,
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Shape {
    /// Joined by a line.
    Line,
    /// Joined by a thin dashed line.
    Dashes,
    /// Each by a dot.
    Dots,
    /// Each by a dot with a thin outline: for colours of a scale, of which some are pale.
    Discs,
    /// Each by a small dot that lets others shine through: for thousands.
    Specks,
    /// Each by a pale disc, around the dots that lie over it: for what is compared with them.
    Halos,
    /// Corners of an area that lets others shine through.
    Area,
    /// Each two joined by a line.
    Segments,
    /// Each two joined by a thick line: for bars from zero.
    Bars,
    /// Not at all: the axes reach so far. For axes that plots share.
    Unseen,
}

/// Colours of marks: named ones that the colour-blind tell apart (Okabe and Ito), and those of a scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Ink {
    /// Black.
    Black,
    /// Grey.
    Grey,
    /// Blue.
    Blue,
    /// Vermilion.
    Vermilion,
    /// Green.
    Green,
    /// Purple.
    Purple,
    /// Red, green and blue of a colour that stands for a number.
    Of([u8; 3]),
}

impl Ink {
    fn hex(self) -> String {
        let [r, g, b] = match self {
            Self::Black => [0x1c, 0x21, 0x28],
            Self::Grey => [0x8a, 0x92, 0x9c],
            Self::Blue => [0x00, 0x72, 0xb2],
            Self::Vermilion => [0xd5, 0x5e, 0x00],
            Self::Green => [0x00, 0x9e, 0x73],
            Self::Purple => [0xa0, 0x55, 0x8a],
            Self::Of(color) => color,
        };
        format!("#{r:02x}{g:02x}{b:02x}")
    }
}

impl Mark {
    /// What stands for it in a legend.
    pub(super) fn sample(&self, x: f64, y: f64) -> String {
        let right = x + 24.0;
        match self.shape {
            Shape::Dots | Shape::Discs | Shape::Specks | Shape::Halos => {
                self.draw(&[Some([x + 12.0, y])])
            }
            Shape::Area => {
                let (top, bottom) = (y - 5.0, y + 5.0);
                self.draw(&[[x, top], [right, top], [right, bottom], [x, bottom]].map(Some))
            }
            Shape::Line | Shape::Dashes | Shape::Segments | Shape::Bars => {
                self.draw(&[[x, y], [right, y]].map(Some))
            }
            Shape::Unseen => String::new(),
        }
    }

    /// It in a picture, from the place of each point, if it has one.
    pub(super) fn draw(&self, places: &[Option<[f64; 2]>]) -> String {
        let ink = self.ink.hex();
        let outlined = format!("fill=\"{ink}\" stroke=\"#5a6370\" stroke-width=\"0.4\"");
        match self.shape {
            Shape::Dots => circles(places, 3.0, &format!("fill=\"{ink}\"")),
            Shape::Discs => circles(places, 4.0, &outlined),
            Shape::Specks => circles(places, 1.2, &format!("fill=\"{ink}\" fill-opacity=\"0.5\"")),
            Shape::Halos => circles(places, 3.4, &format!("fill=\"{ink}\" fill-opacity=\"0.3\"")),
            Shape::Area => area(places, &ink),
            Shape::Line => stroke(&joined(places), &ink, "1.8"),
            Shape::Dashes => stroke(&joined(places), &ink, "1.2\" stroke-dasharray=\"5 4"),
            Shape::Segments => stroke(&segments(places), &ink, "1.4"),
            Shape::Bars => stroke(&segments(places), &ink, "14"),
            Shape::Unseen => String::new(),
        }
    }
}

fn circles(places: &[Option<[f64; 2]>], radius: f64, paint: &str) -> String {
    let circle =
        |[x, y]: &[f64; 2]| format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"/>");
    let circles: String = places.iter().flatten().map(circle).collect();
    format!("<g {paint}>{circles}</g>")
}

fn area(places: &[Option<[f64; 2]>], ink: &str) -> String {
    let corners = places.iter().flatten();
    let corners: Vec<String> = corners.map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    let corners = corners.join(" ");
    format!("<polygon points=\"{corners}\" fill=\"{ink}\" fill-opacity=\"0.16\"/>")
}

/// A path of so wide a line; nothing where it is empty.
fn stroke(path: &str, ink: &str, width: &str) -> String {
    match path {
        "" => String::new(),
        path => format!("<path d=\"{path}\" stroke=\"{ink}\" stroke-width=\"{width}\"/>"),
    }
}

/// The path through places, anew after each gap.
fn joined(places: &[Option<[f64; 2]>]) -> String {
    let corner = |[x, y]: &[f64; 2]| format!("{x:.1} {y:.1}");
    let parts = places
        .split(Option::is_none)
        .filter(|part| !part.is_empty());
    let part = |part: &[Option<[f64; 2]>]| {
        let corners: Vec<String> = part.iter().flatten().map(corner).collect();
        format!("M{}", corners.join("L"))
    };
    parts.map(part).collect()
}

/// The path of lines between each two places.
fn segments(places: &[Option<[f64; 2]>]) -> String {
    let segment = |ends: &[Option<[f64; 2]>]| match ends {
        [Some([a, b]), Some([c, d])] => format!("M{a:.1} {b:.1}L{c:.1} {d:.1}"),
        _ => String::new(),
    };
    places.chunks(2).map(segment).collect()
}
