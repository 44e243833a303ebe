//! Settings of the instrument that the chosen physics passes over or replaces.

use super::survey_place;
use vlscan_base::diag::Diagnostics;
use vlscan_base::quantity::number;
use vlscan_lidar::pulse::{Corrections, InstrumentTable, PhysicsOptions, count_echoes_of_one_pulse};
use vlscan_scene::{OpticsKind, Scene};
use vlscan_survey::{
    AirState, Device, Leg, PlatformKind, Receiver, Survey, WaveformPlace, Weather, WrittenKey,
    warn_of_unused_keys,
};

/// Quotients of window and bin that are less than this below two count as two: rounding.
const WINDOW_TOLERANCE: f64 = 1e-9;
/// False alarms per pulse above which they are reported.
const MAX_FALSE_ALARMS: f64 = 0.01;
/// Threshold over noise of a receiver with hardly any false alarms.
const SAFE_THRESHOLD: f64 = 6.0;
/// Wavelength from which on even pure water attenuates light by more than [`MIN_INFRARED_ATTENUATION`], nm.
const MIN_INFRARED: f64 = 750.0;
/// Attenuation that water exceeds in infrared light, 1/m.
const MIN_INFRARED_ATTENUATION: f64 = 1.0;

/// Checks the scanner of a survey against the physics with `corrections`.
pub fn check_instrument(survey: &Survey, corrections: &Corrections) -> Diagnostics {
    let mut found = Diagnostics::default();
    let is_on = |name: &str| Corrections::by_name(&mut { *corrections }, name).is_some_and(|on| *on);
    warn_of_unused_keys(&survey.scanner.written, is_on, &mut found);
    for device in &survey.scanner.devices {
        check_waveform(device, corrections, &mut found);
    }
    check_reference(survey, corrections, &mut found);
    check_weather(survey, corrections, &mut found);
    if corrections.radiometry {
        check_weather_factors(survey, &mut found);
    }
    found
}

/// Warns of receivers whose noise crosses their detection threshold in many pulses.
pub fn check_noise(survey: &Survey, options: &PhysicsOptions) -> Diagnostics {
    let mut found = Diagnostics::default();
    // An instrument that is impossible is an error of the run.
    let table = InstrumentTable::new(survey, options).ok();
    let Some(alarms) = table.and_then(|table| table.false_alarms()) else { return found };
    if alarms.per_pulse <= MAX_FALSE_ALARMS {
        return found;
    }
    let rate = match alarms.per_pulse {
        per_pulse if per_pulse < 0.5 => format!("one false point in about {:.0} pulses", 1.0 / per_pulse),
        per_pulse => format!("about {per_pulse:.1} false points per pulse"),
    };
    let message = format!(
        "noise of {:.2e} W crosses the detection threshold of {:.2e} W: {rate}",
        alarms.sigma, alarms.threshold
    );
    let is_noise = |key: &&WrittenKey| matches!(key.key.key, "nep_w" | "snr" | "background_w");
    let place = survey.scanner.written.iter().find(is_noise).map(|written| written.place.clone());
    found.warn(place.or_else(|| survey_place(survey)), message).help(format!(
        "a threshold of 6 times the noise, {:.2e} W, has hardly any: raise received_energy_min_w, lower \
         nep_w, or limit range_max_m",
        SAFE_THRESHOLD * alarms.sigma
    ));
    found
}

/// Warns of the older energy model where another one replaces it.
pub fn check_energy_model(survey: &Survey, options: &PhysicsOptions) -> Diagnostics {
    let mut found = Diagnostics::default();
    let (why, remedy) = match (options.corrections.radiometry, survey.scanner.multi_channel) {
        _ if !options.legacy_energy => return found,
        (true, _) => {
            ("with the correction radiometry, which is part of the refined physics", "use --physics helios")
        }
        (false, true) => {
            ("for a scanner of several channels, as in HELIOS++", "use a scanner of one channel")
        }
        _ => return found,
    };
    let message = format!("the older energy model (`legacy_energy`, --legacy-energy) has no effect {why}");
    found.warn(survey_place(survey), message).help(format!("leave it out, or {remedy}"));
    found
}

/// Warns of weather over time that ends before a flight along waypoints starts at `start_ns`, in ns, or
/// begins after it ends at `end` s, if that is known.
pub fn check_weather_times(survey: &Survey, start_ns: f64, end: Option<f64>) -> Diagnostics {
    let mut found = Diagnostics::default();
    if matches!(survey.platform.kind, PlatformKind::Interpolated(_) | PlatformKind::Stream(_)) {
        return found;
    }
    let start = start_ns / 1e9;
    let doubt = |leg: &Leg| match leg.scanner.weather.over_time.as_deref()? {
        [_, .., (last, _)] if leg.scanner.active && *last <= start => Some(format!(
            "ends at {} s, before the run starts at {} s: its last line",
            number(*last),
            number(start)
        )),
        [(first, _), _, ..] if leg.scanner.active && end.is_some_and(|end| end <= *first) => Some(format!(
            "begins at {} s, after the run ends at {} s: its first line",
            number(*first),
            number(end.unwrap_or(start))
        )),
        _ => None,
    };
    if let Some((leg, doubt)) = survey.legs.iter().find_map(|leg| Some((leg, doubt(leg)?))) {
        let message = format!("the file of the weather over time {doubt} applies throughout");
        found
            .warn(leg.place.clone().or_else(|| survey_place(survey)), message)
            .help("give GPS times of the week, as points have them, or start the run with --gps-start");
    }
    found
}

/// Warns of channels whose wavelength differs from the first one's, at which the spectra of a scene are read.
pub fn check_wavelengths(survey: &Survey) -> Diagnostics {
    let mut found = Diagnostics::default();
    let mut wavelengths = survey.scanner.devices.iter().map(|device| device.beam.wavelength);
    let Some(first) = wavelengths.next() else { return found };
    if let Some(other) = wavelengths.find(|wavelength| *wavelength != first) {
        let message = format!(
            "the materials of the scene have spectra, which are evaluated at the {first} nm of the first \
             channel, even for the channel with {other} nm"
        );
        found
            .warn(survey_place(survey), message)
            .help("--correct channel-spectra evaluates them at the wavelength of each channel");
    }
    found
}

/// Warns of water in the scene that is clearer than water can be in the infrared light of the scanner.
pub fn check_water(survey: &Survey, scene: &Scene) -> Diagnostics {
    let mut found = Diagnostics::default();
    let wavelengths = survey.scanner.devices.iter().map(|device| device.beam.wavelength);
    let longest = wavelengths.fold(0.0, f64::max);
    let clear = scene.materials.iter().find_map(|material| match material.optics?.kind {
        OpticsKind::Water(water) if water.attenuation < MIN_INFRARED_ATTENUATION => Some((material, water)),
        _ => None,
    });
    if let Some((material, water)) = clear.filter(|_| longest >= MIN_INFRARED) {
        let message = format!(
            "the water \"{}\" attenuates light by {} per metre, as for visible light, but the wavelength is \
             {} nm",
            material.name,
            number(water.attenuation),
            number(longest)
        );
        found.warn(survey_place(survey), message).help(
            "set `water_attenuation` of the material (`vlscan_water_attenuation` in MTL files): about 7 per \
             metre at 905 nm, 13 at 1064 nm, 1000 at 1550 nm; green and infrared light need a run each",
        );
    }
    found
}

/// Warns of bins in which a single pulse is not exactly one echo, and of windows that the physics replaces.
fn check_waveform(device: &Device, corrections: &Corrections, found: &mut Diagnostics) {
    let (bin, window) = (device.waveform.bin, device.waveform.window);
    let [bin_key, window_key] = device.waveform_place.as_ref().map_or(["bin_ns", "window_ns"], |w| w.keys);
    let place = device.waveform_place.as_ref().map(|WaveformPlace { place, .. }| place.clone());
    if window / bin < 2.0 - WINDOW_TOLERANCE {
        let consequence = match corrections.peak_neighbours {
            true => "a window of two bins is used",
            false => "every bin of the waveform counts as an echo",
        };
        let message =
            format!("`{window_key}` {window} is less than two bins of `{bin_key}` {bin}: {consequence}");
        let help = format!("set `{window_key}` to at least {}, or `{bin_key}` lower", 2.0 * bin);
        found.warn(place, message).help(help);
    } else if count_echoes_of_one_pulse(device, corrections) == Some(0) {
        let (message, help) = if device.receiver.pulse_shape.is_some() && corrections.receiver {
            let message = format!(
                "in bins of {bin} ns (`{bin_key}`) no sample of the pulse's shape is higher than its \
                 neighbours: no echo is detected"
            );
            (message, format!("a flat top is not a peak; change the pulse shape or `{bin_key}`"))
        } else {
            let message = format!(
                "bins of {bin} ns (`{bin_key}`) are too wide for pulses of {} ns: no echo is detected",
                number(device.beam.length(corrections.stated_pulse_widths))
            );
            (message, format!("set `{bin_key}` to a quarter of the pulse length or less"))
        };
        found.warn(place, message).help(help);
    }
}

/// Warns of values with which the formulas of the reference give no result, so that others take their place.
fn check_reference(survey: &Survey, corrections: &Corrections, found: &mut Diagnostics) {
    if corrections.radiometry {
        return;
    }
    let devices = &survey.scanner.devices;
    let help = "`--physics refined` computes it by the lidar equation";
    if !corrections.waist_at_exit && devices.iter().any(|device| device.detector.range_min == 0.0) {
        let message = "with a minimum range of 0 m the physics of HELIOS++, which focuses the beam there, \
                       receives nothing; the waist of the beam is placed at the exit";
        found.warn(survey_place(survey), message).help(help);
    }
    let is_foul = |leg: &&Leg| leg.scanner.weather != Weather::CLEAR;
    if let Some(leg) = survey.legs.iter().find(is_foul) {
        let message = "`weather` has no effect without the correction radiometry of the physics";
        found.warn(leg.place.clone().or_else(|| survey_place(survey)), message).help(help);
    }
    let of_scanner = devices.iter().any(|device| device.beam.divergence == 0.0);
    let leg = survey.legs.iter().find(|leg| leg.scanner.active && leg.scanner.beam_divergence == 0.0);
    if of_scanner || leg.is_some() {
        let message = "with a divergence of 0 rad the physics of HELIOS++ gives NaN amplitudes; all energy \
                       is placed on the axis of the beam";
        let of_leg = leg.filter(|_| !of_scanner).and_then(|leg| leg.place.clone());
        found.warn(of_leg.or_else(|| survey_place(survey)), message).help(help);
    }
}

/// Warns of numbers about light of the air that no leg with light of that kind has.
fn check_weather_factors(survey: &Survey, found: &mut Diagnostics) {
    let active = || survey.legs.iter().filter(|leg| leg.scanner.active);
    let none_has = |has: fn(&AirState) -> bool| {
        !active().any(|leg| {
            let Weather { air, over_time, .. } = &leg.scanner.weather;
            has(air) || over_time.iter().flat_map(|rows| rows.iter()).any(|row| has(&row.1))
        })
    };
    let drops = active().find(|leg| leg.scanner.weather.drop_factor != Weather::CLEAR.drop_factor);
    let ratio = active().find(|leg| leg.scanner.weather.lidar_ratio != Weather::LIDAR_RATIO);
    let is_soft = |air: &AirState| air.fog > 0.0 || air.snow > 0.0 || air.dust > 0.0;
    for (leg, has_none, name, needed) in [
        (drops, none_has(|air| air.rain > 0.0), "drop_factor", "rain (`rain_mm_h`)"),
        (ratio, none_has(is_soft), "lidar_ratio_sr", "fog, snow or dust (`mor_m`, `snow_mm_h`, `dust`)"),
    ] {
        if let Some(leg) = leg.filter(|_| has_none) {
            let message = format!("`{name}` of the weather has no effect: no leg has {needed}");
            found.warn(leg.place.clone().or_else(|| survey_place(survey)), message);
        }
    }
}

/// Warns of fog, rain, snow and dust in front of a receiver that detects any trace of them.
fn check_weather(survey: &Survey, corrections: &Corrections, found: &mut Diagnostics) {
    let returns_light = |leg: &&Leg| {
        let Weather { air, over_time, .. } = &leg.scanner.weather;
        leg.scanner.active && (*air != AirState::default() || over_time.is_some())
    };
    let has_threshold = |device: &Device| {
        let Receiver { max_range, noise, shot, threshold_photons, fmcw, .. } = &device.receiver;
        let is_stated = device.detector.threshold_given || max_range.is_some() || threshold_photons.is_some();
        is_stated || noise.is_some() || shot.is_some() || fmcw.is_some()
    };
    let Some(leg) = survey.legs.iter().find(returns_light) else { return };
    if !corrections.radiometry || survey.scanner.devices.iter().all(has_threshold) {
        return;
    }
    let message =
        "the scanner states no detection threshold: any trace of fog, rain, snow or dust is a point";
    found.warn(leg.place.clone().or_else(|| survey_place(survey)), message).help(
        "give [scanner] the range of a dark target, such as `max_range = { range_m = 100, reflectance = 0.1 \
         }`, or `received_energy_min_w`",
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_scene::{Material, Optics, Water};
    use vlscan_survey::testkit::{survey, tls_device};

    fn report(corrections: Corrections, change: impl Fn(&mut Device)) -> String {
        let mut device = tls_device(4.0);
        change(&mut device);
        check_instrument(&survey(vec![device]), &corrections).text()
    }

    #[test]
    fn windows_below_two_bins_and_bins_wider_than_the_pulse_are_told() {
        let (helios, refined) = (Corrections::NONE, Corrections::REFINED);
        assert_eq!((report(helios, |_| ()), report(refined, |_| ())), (String::new(), String::new()));
        for (bin, window, word, refined_word) in [
            (0.5, 0.5, "every bin of the waveform counts as an echo", "a window of two bins is used"),
            (0.25, 0.49, "every bin of the waveform counts as an echo", "a window of two bins is used"),
            // 0.2/0.1 is 2 in spite of rounding.
            (0.1, 0.2, "", ""),
            (2.0, 4.0, "too wide", ""),
            (9.0, 18.0, "too wide", "too wide"),
        ] {
            for (physics, word) in [(helios, word), (refined, refined_word)] {
                let found = report(physics, |d| (d.waveform.bin, d.waveform.window) = (bin, window));
                assert_eq!(found.is_empty(), word.is_empty(), "{bin} {window}: {found}");
                assert!(found.contains(word), "{bin} {window}: {found}");
            }
        }
    }

    #[test]
    fn pulses_are_as_wide_as_the_instrument_states_them_where_the_physics_takes_that() {
        // The data sheet of a catalogue's instrument says 5 ns at half maximum, which is 10.3 ns in the
        // measure of HELIOS++.
        let report = |corrections: Corrections, bin: f64| {
            report(corrections, |d| {
                (d.beam.pulse_length, d.beam.stated_width) = (5.0, Some(5.0));
                (d.waveform.bin, d.waveform.window) = (bin, 2.0 * bin);
            })
        };
        assert_eq!(report(Corrections::REFINED, 6.0), "");
        assert!(report(Corrections::NONE, 6.0).contains("too wide for pulses of 5 ns"));
        assert!(report(Corrections::REFINED, 30.0).contains("too wide for pulses of 10.3"));
    }

    #[test]
    fn weather_needs_the_lidar_equation() {
        let mut foul = survey(vec![tls_device(4.0)]);
        foul.legs[0].scanner.weather.air.rain = 10.0;
        assert!(check_instrument(&foul, &Corrections::NONE).text().contains("`weather` has no effect"));
        foul.scanner.devices[0].detector.threshold_given = true;
        assert_eq!(check_instrument(&foul, &Corrections::REFINED).text(), "");
    }

    #[test]
    fn weather_without_a_threshold_is_told() {
        let mut foul = survey(vec![tls_device(4.0); 2]);
        let reported = |survey: &Survey| {
            let found = check_instrument(survey, &Corrections::REFINED).text();
            found.contains("the scanner states no detection threshold")
        };
        foul.legs[0].scanner.weather.visibility = Some(5.0);
        assert!(!reported(&foul));
        foul.legs[0].scanner.weather.air.fog = 0.03;
        assert!(reported(&foul));
        foul.scanner.devices[0].detector.threshold_given = true;
        assert!(reported(&foul));
        foul.scanner.devices[1].receiver.threshold_photons = Some(3);
        assert!(!reported(&foul));
        foul.scanner.devices[1].receiver.threshold_photons = None;
        foul.legs[0].scanner.active = false;
        assert!(!reported(&foul));
    }

    #[test]
    fn factors_of_weather_need_light_of_their_kind() {
        let mut foul = survey(vec![tls_device(4.0)]);
        foul.scanner.devices[0].detector.threshold_given = true;
        let reported = |survey: &Survey| {
            let found = check_instrument(survey, &Corrections::REFINED).text();
            ["drop_factor", "lidar_ratio_sr"]
                .map(|key| found.contains(&format!("`{key}` of the weather has no")))
        };
        assert_eq!(reported(&foul), [false; 2]);
        (foul.legs[0].scanner.weather.drop_factor, foul.legs[0].scanner.weather.lidar_ratio) = (2.0, 20.0);
        assert_eq!(reported(&foul), [true; 2]);
        foul.legs[0].scanner.weather.air.rain = 1.0;
        assert_eq!(reported(&foul), [false, true]);
        let snow = AirState { snow: 1.0, ..AirState::default() };
        foul.legs[0].scanner.weather.over_time = Some([(0.0, AirState::default()), (9e9, snow)].into());
        assert_eq!(reported(&foul), [false; 2]);
        foul.legs[0].scanner.weather.air.rain = 0.0;
        assert_eq!(reported(&foul), [true, false]);
        foul.legs[0].scanner.active = false;
        assert_eq!(reported(&foul), [false; 2]);
    }

    #[test]
    fn weather_that_ends_before_the_run_or_begins_after_it_is_told() {
        let mut foul = survey(vec![tls_device(4.0)]);
        let reported = |foul: &Survey| check_weather_times(foul, 86_418e9, Some(86_428.0)).text();
        assert_eq!(reported(&foul), "");
        let over_time = |times: &[f64]| Some(times.iter().map(|time| (*time, AirState::default())).collect());
        for (times, expected) in [
            (&[0.0, 10.0][..], "ends at 10 s, before the run starts at 86418 s: its last line applies"),
            (&[0.0, 86_418.0], "ends at 86418 s, before"),
            (&[0.0, 86_419.0], ""),
            (&[86_427.0, 86_429.0], ""),
            (&[90_000.0, 9e9], "begins at 90000 s, after the run ends at 86428 s: its first line applies"),
            // A single line is constant weather.
            (&[0.0], ""),
            (&[90_000.0], ""),
        ] {
            foul.legs[0].scanner.weather.over_time = over_time(times);
            let found = reported(&foul);
            assert!(
                found.contains(expected) && found.is_empty() == expected.is_empty(),
                "{times:?}: {found}"
            );
        }
        foul.legs[0].scanner.weather.over_time = over_time(&[90_000.0, 90_001.0]);
        assert_eq!(check_weather_times(&foul, 86_418e9, None).text(), "");
        assert_ne!(reported(&foul), "");
        foul.legs[0].scanner.active = false;
        assert_eq!(reported(&foul), "");
    }

    #[test]
    fn channels_of_other_wavelengths_than_that_of_the_spectra_are_told() {
        let wavelengths = |all: &[f64]| {
            let mut devices = vec![tls_device(4.0); all.len()];
            devices.iter_mut().zip(all).for_each(|(device, nm)| device.beam.wavelength = *nm);
            check_wavelengths(&survey(devices)).text()
        };
        assert_eq!((wavelengths(&[532.0]), wavelengths(&[905.0, 905.0])), (String::new(), String::new()));
        let reported = wavelengths(&[1064.0, 1064.0, 532.0]);
        assert!(
            reported.contains("at the 1064 nm of the first channel") && reported.contains("532 nm"),
            "{reported}"
        );
    }

    #[test]
    fn water_as_clear_as_for_visible_light_is_told_of_infrared_scanners() {
        let told = |wavelength: f64, attenuation: f64| {
            let water = Water {
                index: 1.335,
                group_index: 1.357,
                attenuation,
                beam_attenuation: attenuation,
                backscatter: Water::BACKSCATTER,
                slopes: [0.0; 2],
                wind: [0.0, 1.0],
            };
            let optics = Optics { kind: OpticsKind::Water(water), share: 1.0, roughness: 0.0 };
            let lake = Material { optics: Some(optics), ..Material::unnamed("lake", Corrections::REFINED) };
            let mut scene = Scene::default();
            scene.materials.push(lake);
            let mut device = tls_device(4.0);
            device.beam.wavelength = wavelength;
            check_water(&survey(vec![device]), &scene).text()
        };
        assert_eq!((told(532.0, 0.1), told(1064.0, 13.0)), (String::new(), String::new()));
        let found = told(1064.0, 0.1);
        assert!(
            found.contains("\"lake\" attenuates light by 0.1 per metre") && found.contains("1064 nm"),
            "{found}"
        );
        let dry = Scene::default();
        assert_eq!(check_water(&survey(vec![tls_device(4.0)]), &dry).text(), "");
    }

    #[test]
    fn values_without_a_result_in_the_reference_are_told() {
        let (helios, refined) = (Corrections::NONE, Corrections::REFINED);
        assert!(report(helios, |d| d.detector.range_min = 0.0).contains("minimum range of 0 m"));
        assert!(report(helios, |d| d.beam.divergence = 0.0).contains("divergence of 0 rad"));
        assert!(report(helios, |d| d.detector.range_min = 0.0).contains("test.xml"));
        let both = |d: &mut Device| (d.detector.range_min, d.beam.divergence) = (0.0, 0.0);
        assert_eq!(report(refined, both), "");
    }
}
