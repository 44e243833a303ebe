//! A picture from above whose pixels have known coordinates.

use super::PreviewOptions;
use super::colour::{ColourBy, Colouring};
use super::panel::{Panel, View};
use super::style::DARK_GROUND;
use crate::chart::{Frame, Picture};
use crate::cloud::Points;

/// Shortest side of a map, pixels.
const MIN_SIDE: u32 = 64;
/// Longer side from which a map needs [`MAX_POINTS`], pixels.
const SIDE_OF_MAX_POINTS: u64 = 1200;
/// Most points on the surfaces of a scene that are drawn.
const MAX_POINTS: u64 = 1_000_000;

/// A cloud from above, north at the top, without margins, and where it lies.
#[derive(Clone, Debug)]
pub struct Map {
    /// The picture.
    pub picture: Picture,
    /// World coordinates of the centre of the upper left pixel, m.
    pub corner: [f64; 2],
    /// Width and height of a pixel, m.
    pub pixel: f64,
}

impl Map {
    /// Number of points on the surfaces of a scene that fill a map with `side` pixels along its longer side.
    pub fn points(side: u32) -> usize {
        let side = u64::from(side.max(MIN_SIDE));
        (MAX_POINTS * side * side / SIDE_OF_MAX_POINTS.pow(2)).min(MAX_POINTS) as usize
    }

    /// Draws a map with `side` pixels along its longer side, coloured by height and lit from the north-west;
    /// `None` without points.
    pub fn draw(points: &Points, side: u32) -> Option<Map> {
        if points.is_empty() {
            return None;
        }
        let (bounds, origin) = (points.bounds(), points.origin());
        let size = bounds.size();
        let side = side.max(MIN_SIDE);
        let pixel = size.x.max(size.y).max(1e-3) / f64::from(side);
        let pixels = |length: f64| ((length / pixel).ceil() as u32).clamp(MIN_SIDE, side);
        let (width, height) = (pixels(size.x), pixels(size.y));
        let centre = (bounds.centre() - origin).to_array();
        let limit = |corner: vlscan_geom::DVec3, margin: f64| {
            (corner - origin).to_array().map(|c| (c + margin) as f32)
        };
        let frame = Frame { x: 0, y: 0, width, height };
        let keep = [limit(bounds.min, -1.0), limit(bounds.max, 1.0)];
        let panel = Panel {
            view: View::Above,
            frame,
            scale: 1.0 / pixel,
            exaggeration: 1.0,
            centre,
            keep,
            haze: 0.0,
        };
        let mut picture = Picture::new(width, height, DARK_GROUND);
        let options = PreviewOptions::default();
        let colouring = Colouring::new(points, ColourBy::Height, options.heights);
        panel.draw(&mut picture, points, &colouring, DARK_GROUND);
        let middle = bounds.centre();
        let corner =
            [middle.x - 0.5 * f64::from(width - 1) * pixel, middle.y + 0.5 * f64::from(height - 1) * pixel];
        Some(Map { picture, corner, pixel })
    }

    /// The text of its world file, as GIS read them beside pictures: size of a pixel along x, two rotations,
    /// size along y (negative, to the south), and the coordinates of the centre of the upper left pixel, a
    /// number per line.
    pub fn world_file(&self) -> String {
        let Map { corner: [x, y], pixel, .. } = self;
        format!("{pixel}\n0\n0\n-{pixel}\n{x}\n{y}\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::{AttributeSet, PointRow};
    use vlscan_geom::DVec3;

    #[test]
    fn small_maps_need_few_points() {
        assert_eq!([64, 600, 1200, 16_384].map(Map::points), [2844, 250_000, 1_000_000, 1_000_000]);
    }

    #[test]
    fn pixels_are_where_the_world_file_says() {
        let mut points = Points::new(AttributeSet::default());
        for (x, y) in [(0.0, 0.0), (200.0, 100.0), (150.0, 80.0)] {
            points.push(&PointRow { position: DVec3::new(500_000.0 + x, y, x), ..PointRow::default() }, None);
        }
        let map = Map::draw(&points, 400).unwrap();
        assert_eq!((map.picture.width(), map.picture.height()), (400, 200));
        assert_eq!(map.world_file(), "0.5\n0\n0\n-0.5\n500000.25\n99.75\n");
        // The pixel of the third point has a colour, those far from all points have none.
        let at = |x: f64, y: f64| {
            let [left, top] = map.corner;
            let place = [(x - left) / map.pixel, (top - y) / map.pixel].map(|c| c.round() as u32);
            map.picture.dot(place[0], place[1])
        };
        assert_ne!(at(500_150.0, 80.0), DARK_GROUND);
        assert_eq!(at(500_050.0, 80.0), DARK_GROUND);
        assert!(Map::draw(&Points::default(), 400).is_none());
    }
}
