//! Drawings as pixels.

use super::drawing::{Anchor, Drawing, Mark};
use super::{Frame, Picture, Rgb, font};

/// The ground of pictures.
const GROUND: Rgb = [16, 20, 27];

impl Drawing {
    /// The drawing as pixels, light on dark, with smooth edges.
    pub fn picture(&self) -> Picture {
        // Rendered at twice the size, then halved, which smooths slanted lines.
        let dots = |v: f64| (2.0 * v).round().max(0.0) as u32;
        let mut fine = Picture::new(dots(self.width), dots(self.height), GROUND);
        for mark in &self.marks {
            match mark {
                Mark::Stroke { path, width, dashed, role } => {
                    stroke(&mut fine, path, *width, *dashed, role.colour())
                }
                Mark::Below { path, floor, opacity, role } => {
                    let mix = |(over, under): (u8, u8)| {
                        (f64::from(over) * opacity + f64::from(under) * (1.0 - opacity)).round() as u8
                    };
                    let over = role.colour();
                    below(&mut fine, path, *floor, std::array::from_fn(|i| mix((over[i], GROUND[i]))));
                }
                Mark::Dot { at, radius, role, .. } => disc(&mut fine, *at, *radius, role.colour()),
                Mark::Dots { at, width, role } => {
                    at.iter().for_each(|at| disc(&mut fine, *at, 0.5 * width, role.colour()))
                }
                // Text is smooth at its final size.
                Mark::Text { .. } => {}
            }
        }
        let mut picture = fine.halved();
        for mark in &self.marks {
            if let Mark::Text { at: [x, y], text, role, anchor } = mark {
                let wide = font::width(text) * self.text;
                let share = match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => 0.5,
                    Anchor::End => 1.0,
                };
                picture.text([(x - share * wide).round(), y.round()], text, self.text, role.colour());
            }
        }
        picture
    }
}

fn disc(fine: &mut Picture, at: [f64; 2], radius: f64, colour: Rgb) {
    let (x, y, r) = (2.0 * at[0], 2.0 * at[1], 2.0 * radius);
    let mut row = (y - r).floor().max(0.0);
    // Within the picture: beyond 2⁵³ a row more is the same number.
    let last = (y + r).min(f64::from(fine.size()[1]));
    while row <= last {
        let half = (r * r - (row - y) * (row - y)).max(0.0).sqrt();
        let from = (x - half).round().max(0.0);
        let width = ((x + half).round() - from).max(0.0) as u32;
        fine.fill(Frame { x: from as u32, y: row as u32, width, height: 1 }, colour);
        row += 1.0;
    }
}

fn stroke(fine: &mut Picture, path: &[[f64; 2]], width: f64, dashed: bool, colour: Rgb) {
    let mut gone = 0.0;
    for pair in path.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let length = libm::hypot(to[0] - from[0], to[1] - from[1]).min(1e5);
        let steps = (3.0 * length).ceil().max(1.0);
        let mut i = 0.0;
        while i <= steps {
            let share = i / steps;
            let dash = ((gone + share * length) / (4.0 * width.max(1.0))) as u64;
            if !dashed || dash.is_multiple_of(2) {
                disc(
                    fine,
                    [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])],
                    0.5 * width,
                    colour,
                );
            }
            i += 1.0;
        }
        gone += length;
    }
}

fn below(fine: &mut Picture, path: &[[f64; 2]], floor: f64, colour: Rgb) {
    for pair in path.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let mut x = (2.0 * from[0]).round().max(0.0);
        let end = (2.0 * to[0]).min(f64::from(fine.size()[0]));
        while x < end {
            let share = ((x / 2.0 - from[0]) / (to[0] - from[0])).clamp(0.0, 1.0);
            let y = 2.0 * (from[1] + share * (to[1] - from[1]));
            let (upper, lower) = (y.min(2.0 * floor).max(0.0), y.max(2.0 * floor));
            let height = (lower - upper).max(0.0) as u32;
            fine.fill(Frame { x: x as u32, y: upper as u32, width: 1, height }, colour);
            x += 1.0;
        }
    }
}
