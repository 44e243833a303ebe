//! Marks on a plane, and the plane as SVG.

use super::Rgb;
use std::fmt::Write as _;
use vlscan_base::markup::escaped;

/// Role of a mark, which determines its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Titles and the numbers of the main axis.
    Ink,
    /// Other text, the lines of axes.
    Faint,
    /// The lines of a grid.
    Grid,
    /// The area below the first series.
    Area,
    /// A series of values; the colours repeat after [`Role::SERIES`].
    Series(usize),
}

/// Colours of a drawing: dark on white, or the colour scheme of its reader, dark by default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Theme {
    /// Dark on white.
    Light,
    /// As the reader's browser prefers.
    Reader,
}

/// Colours of the series, light on dark and dark on white; those on white can be distinguished with most
/// kinds of colour vision.
const SERIES: [[Rgb; 2]; Role::SERIES] = [
    [[106, 176, 243], [0, 114, 178]],
    [[246, 174, 66], [213, 94, 0]],
    [[118, 204, 120], [0, 158, 115]],
    [[226, 100, 130], [204, 121, 167]],
    [[178, 140, 230], [138, 43, 226]],
    [[236, 220, 110], [230, 159, 0]],
    [[190, 196, 204], [93, 93, 93]],
    [[120, 214, 220], [86, 180, 233]],
];

impl Role {
    /// Number of different colours of series.
    pub const SERIES: usize = 8;

    /// The colour on a dark ground, and on a white one.
    fn colours(self) -> [Rgb; 2] {
        match self {
            Role::Ink => [[226, 231, 236], [22, 32, 43]],
            Role::Faint => [[142, 152, 164], [82, 96, 109]],
            Role::Grid => [[38, 46, 57], [221, 221, 221]],
            Role::Area => [[28, 44, 62], [220, 234, 250]],
            Role::Series(n) => SERIES[n % Role::SERIES],
        }
    }

    /// The colour in pictures, which have a dark ground.
    pub(crate) fn colour(self) -> Rgb {
        self.colours()[0]
    }

    fn class(self) -> String {
        match self {
            Role::Ink => "ink".to_owned(),
            Role::Faint => "faint".to_owned(),
            Role::Grid => "grid".to_owned(),
            Role::Area => "area".to_owned(),
            Role::Series(n) => format!("s{}", n % Role::SERIES),
        }
    }
}

/// Returns the style sheet that gives marks their colours; a page needs it once.
pub fn style(theme: Theme) -> String {
    let sheet = |ground: usize| {
        let series = (0..Role::SERIES).map(Role::Series);
        let roles = [Role::Ink, Role::Faint, Role::Grid, Role::Area].into_iter().chain(series);
        let rule = |role: Role| {
            let [r, g, b] = role.colours()[ground];
            format!(".{0}{{color:#{r:02x}{g:02x}{b:02x}}}", role.class())
        };
        roles.map(rule).collect::<String>()
    };
    let colours = match theme {
        Theme::Light => sheet(1),
        Theme::Reader => format!("{}\n@media (prefers-color-scheme:light){{{}}}", sheet(0), sheet(1)),
    };
    format!(
        "{colours}\n.line{{fill:none;stroke:currentColor;stroke-linejoin:round;stroke-linecap:round}}\
         .full{{fill:currentColor;stroke:none}}\n"
    )
}

/// Alignment of a text at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// Its middle is there.
    Middle,
    /// It ends there.
    End,
}

/// A graphic element, in dots from the upper left corner.
#[derive(Clone, Debug)]
pub enum Mark {
    /// A line through points.
    Stroke {
        /// The points.
        path: Vec<[f64; 2]>,
        /// Width of the line.
        width: f64,
        /// True if the line has gaps.
        dashed: bool,
        /// Decides the colour.
        role: Role,
    },
    /// The area between a path and a horizontal line.
    Below {
        /// The path, from left to right.
        path: Vec<[f64; 2]>,
        /// Height of the horizontal line.
        floor: f64,
        /// Opacity, 0 to 1.
        opacity: f64,
        /// Decides the colour.
        role: Role,
    },
    /// A disc with a tooltip.
    Dot {
        /// The centre.
        at: [f64; 2],
        /// The radius.
        radius: f64,
        /// Decides the colour.
        role: Role,
        /// Text.
        note: String,
    },
    /// Many small discs.
    Dots {
        /// The centres.
        at: Vec<[f64; 2]>,
        /// Diameter of each.
        width: f64,
        /// Decides the colour.
        role: Role,
    },
    /// A line of text.
    Text {
        /// The upper end of capitals, at the side that the anchor says.
        at: [f64; 2],
        /// The text.
        text: String,
        /// Decides the colour.
        role: Role,
        /// The side of the text that is at its place.
        anchor: Anchor,
    },
}

/// Marks on a plane.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// Width, dots.
    pub width: f64,
    /// Height, dots.
    pub height: f64,
    /// Size of the text, in dots of the drawing per dot of a font seven dots high.
    pub text: f64,
    pub(crate) marks: Vec<Mark>,
}

impl Drawing {
    /// An empty drawing.
    pub fn new(width: f64, height: f64, text: f64) -> Drawing {
        Drawing { width, height, text, marks: Vec::new() }
    }

    /// Adds a mark above all others.
    pub fn add(&mut self, mark: Mark) {
        self.marks.push(mark);
    }

    /// Adds text.
    pub fn write(&mut self, at: [f64; 2], text: impl Into<String>, role: Role, anchor: Anchor) {
        self.add(Mark::Text { at, text: text.into(), role, anchor });
    }

    /// Adds a thin straight line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], role: Role) {
        let width = self.text.max(1.0);
        self.add(Mark::Stroke { path: vec![from, to], width, dashed: false, role });
    }

    /// The drawing as an element of a page that has [`style`]. `label` names it to those who cannot see it.
    pub fn svg(&self, label: &str) -> String {
        let size = format!("viewBox=\"0 0 {} {}\"", self.width, self.height);
        self.element(&format!("{size} role=\"img\" aria-label=\"{}\"", escaped(label)), "")
    }

    /// The drawing as a standalone file.
    pub fn file(&self, theme: Theme) -> String {
        let (width, height) = (self.width, self.height);
        let head = format!(
            "xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" font-family=\"sans-serif\""
        );
        let ground = match theme {
            Theme::Light => format!("<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"),
            Theme::Reader => String::new(),
        };
        self.element(&head, &format!("<style>\n{}</style>\n{ground}", style(theme)))
    }

    fn element(&self, attributes: &str, before: &str) -> String {
        let mut out = format!("<svg {attributes} font-size=\"{}\">\n{before}", 11.0 * self.text);
        self.marks.iter().for_each(|mark| self.write_mark(mark, &mut out));
        out + "</svg>\n"
    }

    fn write_mark(&self, mark: &Mark, out: &mut String) {
        let list = |path: &[[f64; 2]]| {
            path.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
        };
        // Writing to a string does not fail.
        let _ = match mark {
            Mark::Stroke { path, width, dashed, role } => {
                let dash = 4.0 * self.text;
                let dashes =
                    if *dashed { format!(" stroke-dasharray=\"{dash} {dash}\"") } else { String::new() };
                writeln!(
                    out,
                    "<polyline class=\"{} line\" stroke-width=\"{width}\"{dashes} points=\"{}\"/>",
                    role.class(),
                    list(path)
                )
            }
            Mark::Below { path, floor, opacity, role } => {
                let [from, to] = [path.first(), path.last()].map(|p| p.map_or(0.0, |p| p[0]));
                writeln!(
                    out,
                    "<polygon class=\"{} full\" fill-opacity=\"{opacity}\" points=\"{from:.1},{floor:.1} {} \
                     {to:.1},{floor:.1}\"/>",
                    role.class(),
                    list(path)
                )
            }
            Mark::Dot { at: [x, y], radius, role, note } => writeln!(
                out,
                "<circle class=\"{} full\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"><title>{}</title>\
                 </circle>",
                role.class(),
                escaped(note)
            ),
            Mark::Dots { at, width, role } => {
                let path: String = at.iter().map(|[x, y]| format!("M{x:.1} {y:.1}h0")).collect();
                writeln!(out, "<path class=\"{} line\" stroke-width=\"{width}\" d=\"{path}\"/>", role.class())
            }
            Mark::Text { at: [x, y], text, role, anchor } => {
                let anchor = match anchor {
                    Anchor::Start => "",
                    Anchor::Middle => " text-anchor=\"middle\"",
                    Anchor::End => " text-anchor=\"end\"",
                };
                writeln!(
                    out,
                    "<text class=\"{} full\" x=\"{x:.1}\" y=\"{:.1}\"{anchor}>{}</text>",
                    role.class(),
                    y + 8.0 * self.text,
                    escaped(text)
                )
            }
        };
    }
}
