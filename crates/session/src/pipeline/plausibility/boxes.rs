//! Comparison of the box of a flight with the box of its scene, in world coordinates.

use super::finding::Finding;
use vlscan_base::quantity::{fixed, metres};
use vlscan_geom::{Aabb, DVec3, UtmZone};

/// Upper bound of the assumed range of a scanner with any settings, m.
pub(super) const MAX_REACH: f64 = 20_000.0;
/// Usual heights of a flight above the highest point of its scene, m.
const MIN_CLEARANCE: f64 = 10.0;
const MAX_CLEARANCE: f64 = 1500.0;
/// Depth below the scene up to which a platform is accepted, m.
const MIN_DEPTH: f64 = 2.0;
/// Plausible magnitudes of the geoid undulation (geoid over ellipsoid), m.
pub(super) const UNDULATION: std::ops::RangeInclusive<f64> = 10.0..=110.0;

/// Finds a flight that cannot reach any part of the scene, or is below it. `reach` is the scanner's maximum
/// range, m.
pub(super) fn compare(who: &str, scene: &Aabb, flight: &Aabb, reach: f64) -> Option<Finding> {
    let gap = (scene.min - flight.max).max(flight.min - scene.max).max(DVec3::ZERO);
    let across = gap.x.hypot(gap.y);
    let depth = scene.min.z - flight.max.z;
    let places = format!("the scene is at {}, {who} at {}", extent(scene), extent(flight));
    if gap.length() > reach {
        let what = if across >= gap.z {
            "away from"
        } else if depth > 0.0 {
            "below"
        } else {
            "above"
        };
        let range = match reach < MAX_REACH {
            true => format!("; the scanner reaches {}", metres(reach)),
            false => String::new(),
        };
        let message = format!("{who} is {} {what} the scene{range}: {places}", metres(gap.length()));
        let help = if across >= gap.z {
            away(scene, flight, gap)
        } else {
            in_centimetres(scene, flight.centre().z).unwrap_or_else(|| heights(flight, depth))
        };
        return Some(Finding::new(message, help));
    }
    // Beside a hill a tripod may be lower than the scene.
    (depth > MIN_DEPTH && across == 0.0).then(|| {
        let message = format!("{who} is {} below the lowest point of the scene: {places}", metres(depth));
        Finding::new(message, heights(flight, depth))
    })
}

/// Returns the likely cause of a flight that misses its scene.
pub(super) fn away(scene: &Aabb, flight: &Aabb, gap: DVec3) -> String {
    let (s, f) = (scene.centre(), flight.centre());
    let apart = (f - s).abs();
    let swapped = Aabb { min: swap(flight.min), max: swap(flight.max) };
    // Around the coordinate origin any flight would be within the scaled scene.
    let is_displaced = s.length() > 10.0 * scene.size().length();
    let scaled =
        |by: f64| is_displaced && overlaps(scene, &Aabb { min: flight.min * by, max: flight.max * by });
    if is_degrees(scene) && !is_degrees(flight) {
        return "the scene's coordinates look like degrees of longitude and latitude; project it to metres \
                first"
            .to_owned();
    }
    // Places around 0, 0 are projected to within the distance of a local scene.
    if !is_local(s) && is_projected_onto(f, s) {
        return "the flight's x and y look like longitude and latitude; name its columns lon and lat, so that \
                they are projected (--trajectory-columns)"
            .to_owned();
    }
    if is_grid(s) != is_grid(f) && (is_local(s) || is_local(f)) {
        let (grid, local) = if is_grid(s) { ("scene", "flight") } else { ("flight", "scene") };
        let by = s - f;
        return format!(
            "the {grid} has coordinates of a grid such as UTM, the {local} has local ones; use one system \
             for both: move the {local} by {:.0}, {:.0}, or the {grid} by the opposite (a translate filter \
             moves a scene)",
            if grid == "scene" { by.x } else { -by.x },
            if grid == "scene" { by.y } else { -by.y }
        );
    }
    if (apart.y - 1e7).abs() < 1e5 {
        return "the northings differ by 10,000 km, the false northing of the southern hemisphere; name the \
                zone with its hemisphere, as in --utm-zone 33S"
            .to_owned();
    }
    if is_grid(s)
        && f.y.abs() >= 1e5
        && (150_000.0..1_000_000.0).contains(&apart.x)
        && apart.y < 0.2 * apart.x
    {
        return format!(
            "the eastings differ by {}, as between neighbouring UTM zones; project both to the same zone \
             (--utm-zone)",
            metres(apart.x)
        );
    }
    if overlaps(scene, &swapped) {
        return "with x and y swapped the flight would be over the scene; x is the easting, y the northing"
            .to_owned();
    }
    for (by, unit) in
        [(0.3048, "feet"), (0.001, "millimetres"), (0.01, "centimetres"), (1000.0, "kilometres")]
    {
        if scaled(by) {
            return format!("read as {unit} the flight would be over the scene; coordinates are in metres");
        }
    }
    for (mirrored, axis) in [(DVec3::new(-1.0, 1.0, 1.0), "x"), (DVec3::new(1.0, -1.0, 1.0), "y")] {
        let (a, b) = (flight.min * mirrored, flight.max * mirrored);
        if gap.length() > 0.0 && overlaps(scene, &Aabb { min: a.min(b), max: a.max(b) }) {
            return format!("with the sign of {axis} reversed the flight would be over the scene");
        }
    }
    "give the flight in the scene's coordinates; `vlscan scene info` shows where a scene is".to_owned()
}

/// A hint at a height in centimetres or millimetres, where a flight in metres would be a usual distance above
/// the scene.
pub(super) fn in_centimetres(scene: &Aabb, height: f64) -> Option<String> {
    let plausible = scene.max.z + MIN_CLEARANCE..=scene.max.z + MAX_CLEARANCE;
    let units = [("centimetres", "cm", 0.01), ("millimetres", "mm", 0.001)];
    let (unit, symbol, factor) = units.into_iter().find(|(.., unit)| plausible.contains(&(height * unit)))?;
    let hint = format!("if its heights are in {unit}, {height:.0} {symbol} are {:.0} m", height * factor);
    Some(hint + "; `z[cm]` and `z[mm]` in the heading of a trajectory convert them")
}

/// Returns the likely cause of a wrong height of a flight, `depth` metres below the ground or the scene.
pub(super) fn heights(flight: &Aabb, depth: f64) -> String {
    if flight.min.z.abs().max(flight.max.z.abs()) < 1e-6 {
        return "all heights of the flight are 0: the column of heights is missing or wrong; name it with \
                --trajectory-columns, or give legs a z or on_ground"
            .to_owned();
    }
    if UNDULATION.contains(&depth) {
        return format!(
            "the heights differ as those above the ellipsoid (GNSS, SBET) and those above a geoid do, by \
             {:.0} m or more; --height-offset adds metres to those of a trajectory, on_ground (in XML \
             onGround) puts a leg on the ground",
            depth.ceil()
        );
    }
    "heights of flight and scene must be in metres above the same level; --height-offset adds metres to \
     those of a trajectory, on_ground (in XML onGround) puts a leg on the ground"
        .to_owned()
}

pub(super) fn extent(b: &Aabb) -> String {
    let axis = |name: &str, lo: f64, hi: f64| {
        let digits = if hi - lo < 1.0 && lo.abs() < 1000.0 { 3 } else { 0 };
        let (lo, hi) = (fixed(lo, digits), fixed(hi, digits));
        if lo == hi { format!("{name} {lo}") } else { format!("{name} {lo} to {hi}") }
    };
    let all = [axis("x", b.min.x, b.max.x), axis("y", b.min.y, b.max.y), axis("z", b.min.z, b.max.z)];
    all.join(", ")
}

fn swap(p: DVec3) -> DVec3 {
    DVec3::new(p.y, p.x, p.z)
}

/// True if the boxes overlap in plan view.
fn overlaps(a: &Aabb, b: &Aabb) -> bool {
    a.min.x <= b.max.x && b.min.x <= a.max.x && a.min.y <= b.max.y && b.min.y <= a.max.y
}

/// True if longitude and latitude `p` (degrees), projected to their UTM zone, are near the position `grid`.
fn is_projected_onto(p: DVec3, grid: DVec3) -> bool {
    const MAX_DISTANCE: f64 = 300_000.0;
    let (latitude, longitude) = (p.y.to_radians(), p.x.to_radians());
    let place = UtmZone::of(latitude, longitude).and_then(|zone| zone.project(latitude, longitude));
    place.is_some_and(|q| (q.easting - grid.x).hypot(q.northing - grid.y) < MAX_DISTANCE)
}

/// True if the coordinates look like easting and northing of a projected system: six or seven digits.
fn is_grid(p: DVec3) -> bool {
    let size = |v: f64, digits: std::ops::Range<f64>| digits.contains(&v.abs());
    size(p.x, 1e5..1e8) && size(p.y, 1e5..1.1e7)
}

fn is_local(p: DVec3) -> bool {
    p.x.abs() < 1e5 && p.y.abs() < 1e5
}

/// True if the coordinates look like longitudes and latitudes: small numbers, and an extent far smaller than
/// that of the heights.
fn is_degrees(b: &Aabb) -> bool {
    let size = b.size();
    let in_range = b.min.x.abs().max(b.max.x.abs()) <= 180.0 && b.min.y.abs().max(b.max.y.abs()) <= 90.0;
    in_range && size.x < 2.0 && size.y < 2.0 && (b.centre().x.abs() > 1.0 || b.centre().y.abs() > 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around(x: f64, y: f64, z: f64, half: f64) -> Aabb {
        let (c, h) = (DVec3::new(x, y, z), DVec3::new(half, half, half.min(10.0)));
        Aabb { min: c - h, max: c + h }
    }

    #[test]
    fn each_kind_of_distance_has_its_cause() {
        let utm = around(476_000.0, 5_429_000.0, 300.0, 100.0);
        for (scene, flight, cause) in [
            (utm, around(0.0, 0.0, 300.0, 100.0), "local ones"),
            (around(50.0, 50.0, 0.0, 100.0), around(476_000.0, 5_429_000.0, 300.0, 100.0), "local ones"),
            (utm, around(43_000.0, 5_432_000.0, 300.0, 100.0), "neighbouring UTM zones"),
            (utm, around(476_000.0 - 320_000.0, 5_431_000.0, 300.0, 100.0), "neighbouring UTM zones"),
            (utm, around(476_000.0, 15_429_000.0, 300.0, 100.0), "southern hemisphere"),
            (utm, around(5_429_000.0, 476_000.0, 300.0, 100.0), "swapped"),
            (utm, around(11.2, 49.0, 300.0, 0.01), "longitude and latitude"),
            (
                around(11.2, 49.0, 300.0, 0.01),
                around(476_000.0, 5_429_000.0, 600.0, 100.0),
                "degrees of longitude",
            ),
            (utm, around(476_000.0 / 0.3048, 5_429_000.0 / 0.3048, 600.0, 100.0), "feet"),
            (utm, around(476_000.0, -5_429_000.0, 600.0, 100.0), "sign of y reversed"),
            (utm, around(476_000.0, 5_529_000.0, 600.0, 100.0), "vlscan scene info"),
            (around(50_000.0, 0.0, 0.0, 100.0), around(0.0, 0.0, 2.0, 0.0), "vlscan scene info"),
        ] {
            let finding = compare("the flight", &scene, &flight, MAX_REACH).expect(cause);
            assert!(finding.help.contains(cause), "{cause}: {finding:?}");
        }
    }

    #[test]
    fn heights_are_compared_with_the_scene_and_the_range() {
        let scene = around(0.0, 0.0, 300.0, 500.0);
        let at = |z: f64| Aabb::around([DVec3::new(-50.0, 0.0, z), DVec3::new(50.0, 0.0, z)]);
        let help = |z: f64, reach: f64| compare("the flight", &scene, &at(z), reach).map(|s| s.help);
        assert!(help(0.0, 1e9).unwrap().contains("all heights of the flight are 0"));
        assert!(help(242.0, 1e9).unwrap().contains("ellipsoid"), "48 m below the lowest point");
        assert!(help(100.0, 1e9).unwrap().contains("same level"));
        assert!(help(2000.0, 1500.0).unwrap().contains("same level"));
        assert_eq!((help(2000.0, 1800.0), help(290.5, 1e9), help(289.0, 1e9)), (None, None, None));
        assert!(help(70_000.0, 1500.0).unwrap().contains("70000 cm are 700 m"));
        assert!(help(700_000.0, 1500.0).unwrap().contains("700000 mm are 700 m"));
    }

    #[test]
    fn a_flight_within_reach_is_left_alone() {
        let scene = around(0.0, 0.0, 0.0, 10.0);
        assert_eq!(compare("leg 0", &scene, &around(80.0, 0.0, 2.0, 0.0), 100.0), None);
        assert!(
            compare("leg 0", &scene, &around(180.0, 0.0, 2.0, 0.0), 100.0).unwrap().message.contains("170 m")
        );
    }
}
