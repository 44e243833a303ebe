//! Check of the points per pulse: detects runs that hit nothing or almost nothing.

use super::finding::Finding;
use super::{boxes, flight_place, ground, is_recording, target, view};
use crate::pipeline::beam_counts::{BeamCounts, BeamLog, SampledBeam};
use crate::pipeline::progress::Progress;
use crate::pipeline::settings::Settings;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use vlscan_base::diag::Notice;
use vlscan_base::error::Result;
use vlscan_base::quantity::{amount, amount_of, fixed, metres, number};
use vlscan_geom::{Aabb, DVec3, Rotation};
use vlscan_scene::Scene;
use vlscan_survey::{PlatformKind, Survey};
use vlscan_trace::Tree;

/// Points per pulse below which a run is reported.
const MIN_YIELD: f64 = 0.01;
/// Points per pulse whose beam hits the box of the scene, below which a run is reported.
const MIN_YIELD_WITHIN: f64 = 0.05;
/// Fraction of beams above the horizon from which the scanner is taken to point upwards.
const MIN_SHARE_UPWARDS: f64 = 0.95;

const WATTS_PER_NANOWATT: f64 = 1e-9;
/// Share of surfaces beyond a limit of the scanner's ranges from which that limit is taken as the cause.
const MIN_SHARE_MISSED: f64 = 0.5;
/// Distance from the scene up to which the beams of a scanner that stands are the cause, not its place, m.
const MAX_STAND_OFF: f64 = 500.0;
/// Height above the scene from which the heights of a flight are the cause of few points, m.
const MAX_HEIGHT: f64 = 10_000.0;

/// Checks whether a run finds too few points for its pulses. The cause is reported once, unless another check
/// has reported it.
pub struct YieldCheck<'a> {
    pub settings: &'a Settings,
    pub scene: &'a Scene,
    pub tree: &'a Tree,
    /// True if legs fire the pulses; a caller may trace none.
    pub has_legs: bool,
    /// True if the cause has been reported.
    pub is_reported: &'a AtomicBool,
    pub observer: &'a (dyn Fn(Notice) + Send + Sync),
}

impl YieldCheck<'_> {
    /// Checks the counters at the end of the run.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Input`] where warnings are errors.
    pub fn run(&self, progress: &Progress) -> Result<()> {
        let (done, beam_counts) = (progress.snapshot(), progress.beam_counts());
        // Beams that met the scene are not explained by where the flight is.
        let is_blind = done.echoes == 0 && unseen(&beam_counts.sum) > 0;
        if self.is_reported.load(Relaxed) && !is_blind {
            return Ok(());
        }
        if let Some(finding) = self.find(done.pulses, done.echoes, &beam_counts) {
            self.is_reported.store(true, Relaxed);
            let found = finding.into_warning(flight_place(&self.settings.survey));
            (self.observer)(Notice::Warnings(found.finish(self.settings.strict)?));
        }
        Ok(())
    }

    /// Finds a run with too few points for its pulses.
    fn find(&self, pulses: u64, echoes: u64, log: &BeamLog) -> Option<Finding> {
        let scene = self.scene;
        let (target, beam_counts) = (target(&self.settings.survey, scene), &log.sum);
        if pulses == 0 && !self.has_legs {
            return None;
        }
        if pulses == 0 {
            let help = "a leg fires when it is active and lasts for at least one pulse period; an \
                        oscillating or rotating mirror fires within its scan angle";
            return Some(Finding::new("no pulse was fired: no leg is active, or all are too short", help));
        }
        let fired = pulses as f64;
        let of_sampled = |count: u64| count as f64 / (beam_counts.sampled as f64).max(1.0);
        let (towards, within) = (of_sampled(beam_counts.towards), of_sampled(beam_counts.within));
        let share = echoes as f64 / fired;
        let fits = |share: f64| {
            view::in_feet(&scene.bounds, scene.shift.z, log.beams.entries(), target.ranges, share)
        };
        let bounds = scene.bounds.translated(scene.shift);
        let flight = beam_counts.origins.translated(scene.shift);
        let above = flight.min.z - bounds.max.z;
        let unit = || match above > MAX_HEIGHT {
            true => boxes::in_centimetres(&bounds, flight.centre().z).or_else(|| fits(0.0)),
            false => fits(0.0),
        };
        if share >= MIN_YIELD && share >= MIN_YIELD_WITHIN * within {
            // The height of other flights has been checked before the run.
            let is_unchecked = self.is_live() && share < view::MIN_SHARE;
            let help = is_unchecked.then(|| fits(view::FITTING_SHARE)).flatten()?;
            let message = format!(
                "{} for {}: the swath is wider than the scene",
                amount_of(echoes as f64, "point"),
                amount_of(fired, "pulse")
            );
            return Some(Finding::new(message, help));
        }
        let hitting = (echoes + unseen(beam_counts)) as f64 / fired;
        let is_blind = echoes == 0 && unseen(beam_counts) > 0;
        if is_blind || hitting >= MIN_YIELD && hitting >= MIN_YIELD_WITHIN * within {
            return Some(match beam_counts.near.count > beam_counts.weak.count {
                true => self.too_near(pulses, echoes, beam_counts),
                false => self.too_weak(pulses, echoes, beam_counts, unit()),
            });
        }
        let message = format!(
            "{} for {}: {:.0} % of the beams point at the box of the scene and {:.0} % meet it within the \
             scanner's range; the scene is at {}, the scanner was at {}",
            amount_of(echoes as f64, "point"),
            amount_of(fired, "pulse"),
            100.0 * towards,
            100.0 * within,
            boxes::extent(&bounds),
            boxes::extent(&flight)
        );
        let help = self.cause(log, target.ranges, [&bounds, &flight]);
        let help = unit().map_or(help.clone(), |hint| format!("{help}; {hint}"));
        Some(Finding::new(message, help))
    }
}

impl YieldCheck<'_> {
    /// The cause of few points, with advice, where most beams do not meet the scene. The boxes are those of
    /// scene and flight, world coordinates.
    fn cause(&self, log: &BeamLog, ranges: [f64; 2], [scene, flight]: [&Aabb; 2]) -> String {
        let (mount, beam_counts) = (self.settings.survey.platform.mount, &log.sum);
        let of_sampled = |count: u64| count as f64 / (beam_counts.sampled as f64).max(1.0);
        let towards = of_sampled(beam_counts.towards);
        let above = flight.min.z - scene.max.z;
        let gap = (scene.min - flight.max).max(flight.min - scene.max).max(DVec3::ZERO);
        let across = gap.x.hypot(gap.y);
        let origins: Vec<DVec3> = log.beams.entries().iter().map(|beam| beam.origin).collect();
        let below = ground::check("the flight", self.scene, self.tree, &origins, mount.offset.z);
        let farthest = ranges[1];
        if across > farthest.min(boxes::MAX_REACH) || across > 0.0 && towards < 0.01 {
            self.cause_outside([scene, flight], gap, farthest)
        } else if let Some(below) = below {
            format!("{}; {}", below.message, below.help)
        } else if flight.max.z < scene.min.z {
            let depth = scene.min.z - flight.max.z;
            format!(
                "the flight is {} below the scene; {}",
                metres(depth),
                boxes::heights(&flight.translated(DVec3::Z * -mount.offset.z), depth)
            )
        } else if above > MAX_HEIGHT {
            format!("the flight is {} above the scene; heights of both must be in metres", metres(above))
        } else if towards < 0.5 && mount.rotation == Rotation::IDENTITY {
            "no mount turns the scanner towards the scene: name the platform it is mounted on ([platform] \
             catalogue = \"data/platforms.xml#sr22\"), or give it a mount of its own"
                .to_owned()
        } else if of_sampled(beam_counts.upwards) > MIN_SHARE_UPWARDS {
            "all beams point upwards: the scanner's mount, or roll and pitch of the flight, turn it the \
             wrong way"
                .to_owned()
        } else if towards < 0.5 {
            "the beams miss the scene: attitude, mount or scan angle point them elsewhere, or the flight \
             passes beside it; `vlscan pulses` shows origins and directions"
                .to_owned()
        } else if let Some(advice) = self.limits_missed(log, ranges) {
            advice
        } else {
            let has_optics = self.scene.materials.iter().any(|material| material.optics.is_some());
            let or = match has_optics {
                true => ", or are mirrors, panes and water that show nothing within reach",
                false => "",
            };
            format!(
                "the beams cross the scene's box but hit little: surfaces fill a small part of it{or}; \
                 `vlscan scene info` shows what it contains"
            )
        }
    }

    /// The cause of few points of a flight beside the scene, `gap` from it, with advice.
    fn cause_outside(&self, [scene, flight]: [&Aabb; 2], gap: DVec3, farthest: f64) -> String {
        let across = gap.x.hypot(gap.y);
        let stands = matches!(self.settings.survey.platform.kind, PlatformKind::Static);
        let advice = match stands && across <= farthest.min(MAX_STAND_OFF) {
            true => {
                "head, scan angles or pattern point the beams elsewhere; `vlscan pulses` shows origins and \
                     directions"
                    .to_owned()
            }
            false => boxes::away(scene, flight, gap),
        };
        format!("the flight stays {} beside the scene; {advice}", metres(across))
    }

    /// True if the flight was not read before the run.
    fn is_live(&self) -> bool {
        let kind = &self.settings.survey.platform.kind;
        matches!(kind, PlatformKind::Stream(stream) if !is_recording(stream))
    }

    /// The finding of a run whose pulses hit, and whose detector needs more light than is returned.
    fn too_weak(
        &self,
        pulses: u64,
        echoes: u64,
        beam_counts: &BeamCounts,
        height: Option<String>,
    ) -> Finding {
        let weak = &beam_counts.weak;
        let corrections = &self.settings.physics.corrections;
        let unit = match corrections.threshold_in_watts {
            true => "",
            false => ", as --physics helios has it (receivedEnergyMin_W compared with nanowatts)",
        };
        let threshold = format!("threshold {:.2e} W{unit}", weak.threshold * WATTS_PER_NANOWATT);
        // The strongest light is that of all surfaces on the way of a beam, up to the threshold.
        let light = match weak.strongest < weak.threshold {
            true => format!(
                "strongest {:.2e} W, {threshold}{}",
                weak.strongest * WATTS_PER_NANOWATT,
                lacking(weak.threshold / weak.strongest)
            ),
            false => format!("{threshold}, which the light of one range alone does not reach"),
        };
        let message = format!(
            "{} for {}: {} met the scene and returned less than the detector needs: {light}; {}",
            amount_of(echoes as f64, "point"),
            amount_of(pulses as f64, "pulse"),
            amount_of(weak.count as f64, "beam"),
            others(beam_counts.near.count, "too near", pulses.saturating_sub(unseen(beam_counts) + echoes))
        );
        let help = if corrections.radiometry {
            "fly lower (the power falls with the square of the range), or give the scanner more \
             pulse_energy_uj (the energy of a pulse falls with the pulse rate if only average_power_w is \
             given), more receiver_diameter_m, a lower received_energy_min_w, a max_range, or more \
             visibility_km for a long way through haze; `vlscan scene info` lists the reflectances (0 to 1)"
        } else {
            "--physics refined computes received power in watts; in --physics helios it falls with the \
             fourth power of the range, so fly lower, or give reflectances (`vlscan scene info` lists them) \
             and the threshold in its units"
        };
        let air = in_weather(&self.settings.survey).filter(|_| corrections.radiometry);
        let hints: Vec<String> =
            air.map(str::to_owned).into_iter().chain(height).chain([help.to_owned()]).collect();
        Finding::new(message, hints.join("; "))
    }

    /// The finding of a run whose pulses hit within the dead zone.
    fn too_near(&self, pulses: u64, echoes: u64, beam_counts: &BeamCounts) -> Finding {
        let near = &beam_counts.near;
        let message = format!(
            "{} for {}: {} met the scene and were discarded, as --physics helios has it, because light came \
             from nearer than {} m, which is range_min_m ({} m) and the rise of the pulse; {}",
            amount_of(echoes as f64, "point"),
            amount_of(pulses as f64, "pulse"),
            amount_of(near.count as f64, "beam"),
            fixed(near.dead_zone, 2),
            number(near.range_min),
            others(beam_counts.weak.count, "too weak", pulses.saturating_sub(unseen(beam_counts) + echoes))
        );
        // Rounded down to centimetres, so that the nearest light is beyond the dead zone.
        let range_min = ((near.nearest - (near.dead_zone - near.range_min)) * 100.0).floor() / 100.0;
        let less = match range_min >= 0.0 {
            true => format!(", or give the scanner a range_min_m (rangeMin_m) of {}", number(range_min)),
            false => String::new(),
        };
        let help = format!(
            "--physics refined, or --correct clip-dead-zone, measures from range_min_m on; otherwise stand \
             farther from the surfaces{less}"
        );
        Finding::new(message, help)
    }

    /// Advice where most of the surfaces that beams meet are nearer, or most are farther, than the scanner
    /// measures.
    fn limits_missed(&self, log: &BeamLog, [nearest, farthest]: [f64; 2]) -> Option<String> {
        let cast = |beam: &SampledBeam| {
            let hit = self.scene.nearest_where(self.tree, beam.origin, beam.direction, |_, _| true);
            hit.map(|hit| hit.t)
        };
        let aimed = log.aimed.entries();
        let mut ranges: Vec<f64> = aimed.iter().filter_map(cast).collect();
        // Surfaces that fill a small part of the box are missed by the sample; then the distance of the box
        // counts.
        if ranges.is_empty() {
            let to_box = |beam: &SampledBeam| self.scene.bounds.slabs(beam.origin, beam.direction);
            ranges = aimed.iter().filter_map(to_box).map(|(enter, _)| enter).filter(|t| *t > 0.0).collect();
        }
        ranges.sort_by(f64::total_cmp);
        let share = |count: usize| count as f64 / ranges.len().max(1) as f64;
        let near = ranges.partition_point(|range| *range < nearest);
        let far = ranges.len() - ranges.partition_point(|range| *range <= farthest);
        let typical = ranges.get(ranges.len() / 2).copied()?;
        let measures = format!(
            "the scanner measures from {} to {}, and most surfaces are about {} away",
            metres(nearest),
            range(farthest),
            metres(typical)
        );
        if share(near) > MIN_SHARE_MISSED {
            Some(format!(
                "{measures}, which is nearer: fly higher, stand farther from them, or name another scanner"
            ))
        } else if share(far) > MIN_SHARE_MISSED {
            Some(format!(
                "{measures}, which is farther: fly lower, stand closer to them, or name another scanner"
            ))
        } else {
            None
        }
    }
}

/// Advice for a survey in fog, rain, snow or dust.
fn in_weather(survey: &Survey) -> Option<&'static str> {
    let is_foul = survey.legs.iter().any(|leg| leg.scanner.active && !leg.scanner.weather.is_clear());
    is_foul.then_some("fog, rain, snow and dust dim the light: reduce them in `weather` of the settings")
}

/// Number of pulses that met the scene and gave no echo.
fn unseen(beam_counts: &BeamCounts) -> u64 {
    beam_counts.weak.count + beam_counts.near.count
}

/// Describes the pulses without an echo that have another cause: `count` for `reason`, and those that met
/// nothing.
fn others(count: u64, reason: &str, missed: u64) -> String {
    let missed = format!("{} met nothing within the scanner's range", amount(missed as f64));
    match count {
        0 => missed,
        count => format!("{} were {reason}; {missed}", amount(count as f64)),
    }
}

/// How many times more light the detector needs, where that is a number.
fn lacking(factor: f64) -> String {
    match factor.is_finite() && factor > 1.0 {
        true if factor < 1e4 => format!(", {} times as much", (factor * 10.0).round() / 10.0),
        true => format!(", {factor:.0e} times as much"),
        false => String::new(),
    }
}

fn range(farthest: f64) -> String {
    if farthest < 1e6 { metres(farthest) } else { "any distance".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_lidar::pulse::{NearPulses, WeakPulses};
    use vlscan_survey::{Mount, ReadOptions, read_survey};
    use vlscan_trace::{BuildOptions, Builder, Geometry};

    /// Returns the help for a run of 10 000 pulses from `place`, of a scanner for 1 to 500 m, over a square
    /// of 20 m at height 0. `beams` counts, of a hundred, the beams that point at its box, hit it within the
    /// range, and point upwards. `weak` pulses hit and were too weak.
    fn find(place: [f64; 3], echoes: u64, beams: [u64; 3], weak: u64) -> Option<Finding> {
        find_with(place, echoes, beams, weak, NearPulses::default())
    }

    /// [`find`] with `near` pulses that hit within the dead zone.
    fn find_with(
        place: [f64; 3],
        echoes: u64,
        beams: [u64; 3],
        weak: u64,
        near: NearPulses,
    ) -> Option<Finding> {
        let corners = [[-10.0, -10.0, 0.0], [10.0, -10.0, 0.0], [10.0, 10.0, 0.0], [-10.0, 10.0, 0.0]];
        let geometry = Geometry {
            vertices: corners.map(DVec3::from).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Geometry::default()
        };
        let scene = Scene { bounds: geometry.bounds(), geometry, ..Scene::default() };
        let tree = scene.tree(&BuildOptions::of(Builder::Bvh));
        let (place, [towards, within, upwards]) = (DVec3::from(place), beams);
        let mut beam_counts = BeamLog::default();
        let origins = Aabb::around([place]);
        let weak = WeakPulses { count: weak, strongest: 3.0, threshold: 10.0 };
        let beam = Some(SampledBeam { origin: place, direction: -DVec3::Z });
        beam_counts.add(&BeamCounts {
            sampled: 100,
            towards,
            within,
            upwards,
            origins,
            beam,
            aimed: beam,
            weak,
            near,
        });
        let path = std::path::Path::new("../../fixtures/room/survey.xml");
        let mut settings = Settings::new(read_survey(path, &ReadOptions::default()).unwrap().0);
        let detector = &mut settings.survey.scanner.devices[0].detector;
        (detector.range_min, detector.range_max) = (1.0, 500.0);
        // A mount with rotation, so that a missing mount is not the cause.
        settings.survey.platform.mount = Mount { rotation: Rotation::about_x(1.0), ..Mount::IDENTITY };
        let check = YieldCheck {
            settings: &settings,
            scene: &scene,
            tree: &tree,
            has_legs: true,
            is_reported: &AtomicBool::new(false),
            observer: &|_| (),
        };
        check.find(10_000, echoes, &beam_counts)
    }

    #[test]
    fn few_points_have_a_cause() {
        let end = |place, echoes, beams| find(place, echoes, beams, 0).map(|finding| finding.help);
        assert_eq!(end([0.0, 0.0, 50.0], 9000, [100, 100, 0]), None);
        assert_eq!(
            end([0.0, 0.0, 50.0], 101, [20, 20, 0]),
            None,
            "more than a hundredth, and than a twentieth of a fifth"
        );
        for (place, beams, cause) in [
            ([0.0, 0.0, 50.0], [0, 0, 100], "point upwards"),
            ([0.0, 0.0, 50.0], [0, 0, 0], "miss the scene"),
            ([0.0, 0.0, 900.0], [100, 0, 0], "farther: fly lower"),
            ([0.0, 0.0, 20_000.0], [0, 0, 0], "20000 cm are 200 m"),
            ([0.0, 0.0, 300_000.0], [0, 0, 0], "300000 mm are 300 m"),
            ([0.0, 0.0, 5e6], [0, 0, 0], "heights of both must be in metres"),
            ([0.0, 0.0, 0.5], [100, 0, 0], "nearer: fly higher"),
            ([0.0, 0.0, -50.0], [0, 0, 0], "below the terrain"),
            ([300.0, 0.0, 50.0], [0, 0, 0], "290 m beside the scene; head, scan angles or pattern"),
            ([900.0, 0.0, 50.0], [0, 0, 0], "890 m beside the scene; give the flight"),
            ([0.0, 0.0, 50.0], [100, 100, 0], "hit little"),
        ] {
            let help = end(place, 0, beams).expect(cause);
            assert!(help.contains(cause), "{cause}: {help}");
        }
    }

    #[test]
    fn heights_in_feet_are_suspected_where_they_would_fit() {
        let help = find([0.0, 0.0, 900.0], 0, [100, 0, 0], 0).unwrap().help;
        assert!(help.contains("900 ft are 274 m"), "{help}");
        let help = find([0.0, 0.0, 50.0], 0, [100, 100, 0], 0).unwrap().help;
        assert!(!help.contains("feet"), "{help}");
    }

    #[test]
    fn light_that_is_too_weak_is_the_cause_whatever_the_beams_point_at() {
        for beams in [[100, 100, 0], [10, 10, 0]] {
            let found = find([0.0, 0.0, 50.0], 0, beams, 900).unwrap();
            for part in [
                "900 beams met the scene",
                "strongest 3.00e-9 W, threshold 1.00e-8 W",
                "3.3 times as much",
                "9.10 k met nothing within the scanner's range",
            ] {
                assert!(found.message.contains(part), "{}", found.message);
            }
        }
        assert_eq!(find([0.0, 0.0, 50.0], 9000, [100, 100, 0], 1000), None);
    }

    #[test]
    fn weather_is_named_where_it_dims_the_light() {
        let path = std::path::Path::new("../../fixtures/room/survey.xml");
        let mut survey = read_survey(path, &ReadOptions::default()).unwrap().0;
        assert_eq!(in_weather(&survey), None);
        survey.legs[0].scanner.weather.air.dust = 50.0;
        assert!(in_weather(&survey).is_some_and(|advice| advice.contains("`weather`")));
    }

    #[test]
    fn light_from_the_dead_zone_is_the_cause_where_most_pulses_hit_there() {
        let near = |count, nearest| NearPulses { count, nearest, dead_zone: 0.541, range_min: 0.0914 };
        let find = |weak, near| find_with([0.0, 0.0, 0.5], 0, [100, 100, 0], weak, near).unwrap();
        let found = find(0, near(900, 0.5));
        for part in [
            "900 beams met the scene and were discarded",
            "nearer than 0.54 m, which is range_min_m (0.0914 m)",
            "; 9.10 k met nothing within the scanner's range",
        ] {
            assert!(found.message.contains(part), "{}", found.message);
        }
        // The rise of the pulse is 0.4496 m long.
        assert!(found.help.ends_with("a range_min_m (rangeMin_m) of 0.05"), "{}", found.help);
        let found = find(100, near(900, 0.3));
        assert!(found.message.contains("; 100 were too weak; 9.00 k met nothing"), "{}", found.message);
        assert!(found.help.ends_with("farther from the surfaces"), "no minimum range helps: {}", found.help);
        let found = find(900, near(100, 0.5));
        assert!(found.message.contains("; 100 were too near; 9.00 k met nothing"), "{}", found.message);
        assert!(found.message.contains("strongest 3.00e-9 W"), "{}", found.message);
    }
}
