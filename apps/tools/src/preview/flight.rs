//! Pictures of planned flights: flight lines with their numbers, the outline of the area that they cover, and
//! a map of the pulses that it receives.

use super::PreviewOptions;
use super::colour::{ColourBy, Colouring, object_colour};
use super::layout::Sheet;
use super::panel::Panel;
use crate::chart::{Frame, Picture, Rgb, font};
use crate::cloud::Points;

/// Width of a flight line, units of the font.
const LINE_WIDTH: f64 = 1.4;
/// Distance of a number from the start of its line, units of the font.
const NUMBER_DISTANCE: f64 = 8.0;

/// A planned flight over the points of its scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlightMap {
    /// Horizontal positions along each flight line, world coordinates, m; a single one of an instrument that
    /// stands. Lines are numbered from 1.
    pub lines: Vec<Vec<[f64; 2]>>,
    /// Sides of the outline of the area that the flight covers, world coordinates, m.
    pub outline: Vec<[[f64; 2]; 2]>,
    /// Expected number of pulses per m² at each point of the scene, in their order; 0 where none arrives.
    pub density: Vec<f32>,
}

impl FlightMap {
    /// Colour of the line of an index in pictures.
    fn colour(index: usize) -> Rgb {
        object_colour(index)
    }
}

/// Draws a planned flight over its scene. Instead of legs, colours show the density of pulses.
pub fn draw_flight(points: &Points, flight: &FlightMap, options: &PreviewOptions) -> Picture {
    let colouring = match options.colour {
        ColourBy::Leg => Colouring::of_values("pulses per m²", flight.density.clone()),
        colour => Colouring::new(points, colour, options.heights),
    };
    let is_place = |position: &&[f64; 2]| position.iter().all(|v| v.is_finite());
    let positions: Vec<[f64; 2]> = flight.lines.iter().flatten().filter(is_place).copied().collect();
    let sheet = Sheet::new(points, &positions, options);
    let mut picture = sheet.draw(points, &colouring);
    if let Some(panel) = sheet.above() {
        Overlay { sheet: &sheet, panel }.draw(flight, &mut picture);
    }
    picture
}

/// The view from above, over which a flight is drawn.
struct Overlay<'s> {
    sheet: &'s Sheet,
    panel: &'s Panel,
}

impl Overlay<'_> {
    fn place(&self, position: [f64; 2]) -> [f64; 2] {
        self.panel.place(self.sheet.origin, position)
    }

    fn draw(&self, flight: &FlightMap, picture: &mut Picture) {
        let Sheet { text, style, .. } = *self.sheet;
        let pen = (1.2 * text).max(2.0);
        for (pen, colour) in [(pen + 2.0 * text, style.ground), (pen, style.ink)] {
            for side in &flight.outline {
                picture.path(&side.map(|corner| self.place(corner)), pen, colour);
            }
        }
        // Each line covers some dots completely.
        let pen = (LINE_WIDTH * text).max(3.0);
        let paths: Vec<Vec<[f64; 2]>> = flight
            .lines
            .iter()
            .map(|line| line.iter().map(|position| self.place(*position)).collect())
            .collect();
        for (pen, is_halo) in [(pen + 2.0 * text, true), (pen, false)] {
            for (index, path) in paths.iter().enumerate() {
                let colour = if is_halo { style.ground } else { FlightMap::colour(index) };
                match path[..] {
                    [at] => picture.path(&[at, at], 3.0 * pen, colour),
                    _ => picture.path(path, pen, colour),
                }
            }
        }
        for (number, at) in numbers(&paths, self.panel.frame, text) {
            let colour = FlightMap::colour(number - 1);
            picture.text_on(at, &number.to_string(), text, colour, style.ground);
        }
    }
}

/// The numbers of lines and their upper left corners, ahead of the starts of the lines, but within the frame
/// of the view: captions and coordinates are around it. Numbers that would overlap earlier ones are left out.
fn numbers(paths: &[Vec<[f64; 2]>], frame: Frame, text: f64) -> Vec<(usize, [f64; 2])> {
    let [left, top, wide, high] = [frame.x, frame.y, frame.width, frame.height].map(f64::from);
    let mut placed: Vec<(usize, [f64; 2], f64)> = Vec::new();
    for (number, path) in (1_usize..).zip(paths) {
        let Some(start) = path.first() else { continue };
        // The number of an instrument that stands is above it.
        let towards = path.iter().find(|p| *p != start).copied().unwrap_or([start[0], start[1] + 1.0]);
        let [dx, dy] = [towards[0] - start[0], towards[1] - start[1]];
        let back = NUMBER_DISTANCE * text / libm::hypot(dx, dy).max(1e-9);
        let size = [font::width(&number.to_string()) * text, font::HEIGHT * text];
        let corner = [start[0] - back * dx - 0.5 * size[0], start[1] - back * dy - 0.5 * size[1]];
        if !corner.iter().all(|v| v.is_finite()) {
            continue;
        }
        // No clamp: a frame may be smaller than a number.
        let corner =
            [corner[0].min(left + wide - size[0]).max(left), corner[1].min(top + high - size[1]).max(top)];
        let overlaps = |(_, [x, y], wide): &(usize, [f64; 2], f64)| {
            corner[0] < x + wide + text
                && *x < corner[0] + size[0] + text
                && (y - corner[1]).abs() < size[1] + text
        };
        if !placed.iter().any(overlaps) {
            placed.push((number, corner, size[0]));
        }
    }
    placed.into_iter().map(|(number, corner, _)| (number, corner)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::PointRow;
    use vlscan_geom::DVec3;

    /// A plain of 200 by 100 m, and a flight of three lines over its middle.
    fn plan() -> (Points, FlightMap) {
        let mut points = Points::default();
        let mut density = Vec::new();
        for i in 0..20_000 {
            let (x, y) = (f64::from(i % 200), f64::from(i / 200));
            let position = DVec3::new(500_000.0 + x, 5_400_000.0 + y, 0.01 * x);
            points.push(&PointRow { position, ..PointRow::default() }, None);
            density.push(if (20.0..=80.0).contains(&y) { 4.0 + 0.1 * y as f32 } else { 0.0 });
        }
        let line = |y: f64| (0..=10).map(|i| [500_000.0 + 20.0 * f64::from(i), 5_400_000.0 + y]).collect();
        let corner = |x: f64, y: f64| [500_000.0 + x, 5_400_000.0 + y];
        let corners = [corner(0.0, 20.0), corner(199.0, 20.0), corner(199.0, 80.0), corner(0.0, 80.0)];
        let outline = (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect();
        (points, FlightMap { lines: vec![line(30.0), line(50.0), line(70.0)], outline, density })
    }

    fn dots(picture: &Picture, colour: Rgb) -> Vec<[u32; 2]> {
        let all = (0..picture.height()).flat_map(|y| (0..picture.width()).map(move |x| [x, y]));
        all.filter(|[x, y]| picture.dot(*x, *y) == colour).collect()
    }

    #[test]
    fn every_line_has_a_colour_and_a_number() {
        let (points, flight) = plan();
        let options =
            PreviewOptions { colour: ColourBy::Leg, width: 1000, height: 800, ..Default::default() };
        let picture = draw_flight(&points, &flight, &options);
        let without = draw_flight(&points, &FlightMap { lines: Vec::new(), ..flight.clone() }, &options);
        assert_eq!((picture.width(), picture.height()), (1000, 800));
        let mut heights = Vec::new();
        for index in 0..3 {
            let drawn = dots(&picture, FlightMap::colour(index));
            assert!(drawn.len() > 500, "line {}: {} dots", index + 1, drawn.len());
            assert!(dots(&without, FlightMap::colour(index)).len() < 20);
            heights.push(drawn[drawn.len() / 2][1]);
        }
        // From the south to the north, which is upwards.
        assert!(heights.is_sorted_by(|a, b| a > b), "{heights:?}");
        let paths = [vec![[100.0, 50.0], [200.0, 50.0]], vec![[100.0, 90.0], [100.0, 90.0], [100.0, 10.0]]];
        // To the left of a line to the right, below a line upwards, both centred.
        let frame = Frame { x: 0, y: 0, width: 300, height: 200 };
        assert_eq!(numbers(&paths, frame, 1.0), [(1, [89.5, 46.5]), (2, [97.5, 94.5])]);
        let twice = [paths[0].clone(), paths[0].clone(), Vec::new(), vec![[f64::NAN, 0.0]]];
        assert_eq!(numbers(&twice, frame, 1.0).len(), 1);
        // Numbers stay within the frame: 5 by 7 dots.
        let narrow = Frame { x: 95, y: 20, width: 100, height: 75 };
        assert_eq!(numbers(&paths, narrow, 1.0), [(1, [95.0, 46.5]), (2, [97.5, 88.0])]);
    }

    #[test]
    fn the_map_shows_the_density_and_the_outline_of_what_is_covered() {
        let (points, flight) = plan();
        let options =
            PreviewOptions { colour: ColourBy::Leg, width: 1000, height: 800, ..Default::default() };
        let colours = |flight: &FlightMap| {
            let picture = draw_flight(&points, flight, &options);
            let ink = Sheet::new(&points, &[], &options).style.ink;
            dots(&picture, ink).len()
        };
        let bare = FlightMap { density: flight.density.clone(), ..FlightMap::default() };
        assert!(
            colours(&FlightMap { outline: flight.outline.clone(), ..bare.clone() }) > colours(&bare) + 400
        );
        let colouring = Colouring::of_values("pulses per m²", flight.density);
        let [covered, sparse, none] = [70, 25, 5].map(|y| colouring.of(&points, y * 200 + 100));
        assert!(covered != sparse && sparse != none && none == colouring.of(&points, 0));
    }

    #[test]
    fn odd_flights_are_drawn() {
        let (points, flight) = plan();
        let nowhere = vec![vec![], vec![[f64::NAN, 0.0]], vec![[1e300, -1e300], [0.0, f64::INFINITY]]];
        for lines in [nowhere, vec![vec![[500_050.0, 5_400_050.0]]]] {
            for points in [&points, &Points::default()] {
                let options = PreviewOptions { width: 500, height: 400, ..Default::default() };
                draw_flight(points, &FlightMap { lines: lines.clone(), ..flight.clone() }, &options);
            }
        }
    }
}
