//! Values that contradict each other, mean nothing or stand where nothing is read.

use super::values::{OPTICS, legs, read, survey};
use super::*;

#[test]
fn nan_is_no_value() {
    let turning = format!("{} headRotatePerSecMax_deg='60'>", OPTICS[0]);
    let of = |platform: &str, scanner: &str, scene: &str| {
        let text = survey(&turning, "type='linearpath'>", "", "", &legs(platform, scanner));
        read(&text.replace("<scene id='scene'", &format!("<scene id='scene' {scene}")))
    };
    assert!(of("", "", "").is_some());
    for (platform, scanner, scene) in [
        ("", "verticalAngleMin_deg='nan'", ""),
        ("", "verticalAngleMax_deg='NaN'", ""),
        ("yawAtDeparture_deg='nan'", "", ""),
        ("", "", "dynTimeStep='nan'"),
    ] {
        assert!(of(platform, scanner, scene).is_none(), "{platform}{scanner}{scene}");
    }
}

#[test]
fn limits_that_turn_the_pattern_round_or_do_nothing_are_answered() {
    let plane = "type='linearpath'>";
    let of = |scanner: &str| read(&survey(scanner, plane, "", "", &legs("", "")));
    for optics in ["conic", "line", "rotating", "oscillating"] {
        for attribute in ["scanAngleMax_deg", "scanAngleEffectiveMax_deg"] {
            let is_read = optics == "rotating" || attribute == "scanAngleMax_deg";
            let found = of(&format!("optics='{optics}' {attribute}='-20'>"));
            assert!(found.is_none() || !is_read, "{optics} {attribute}");
        }
    }
    assert!(of("optics='conic' scanAngleMax_deg='20' scanAngleAlongMax_deg='-5'>").is_none());
    for (scanner, warning) in [
        ("optics='conic'>", "conic optics without `scanAngleMax_deg` never deflect"),
        (
            "optics='conic' scanAngleMax_deg='0'>",
            "`scanAngle_deg` has no effect: the largest angle of the scanner is 0",
        ),
        ("optics='line' numFibers='9'>", "line optics without `scanAngleMax_deg` never deflect"),
        ("optics='line' scanAngleMax_deg='20'>", "without `numFibers` have a single fibre"),
        (
            "optics='conic' scanAngleMax_deg='20' scanFreqMin_Hz='20' scanFreqMax_Hz='0'>",
            "`scanFreqMax_Hz` is 0, which means no limit, although `scanFreqMin_Hz` is 20",
        ),
        (
            "optics='conic' scanAngleMax_deg='20' headRotatePerSecMax_deg='-60'>",
            "its amount, 60 °/s, is the limit",
        ),
    ] {
        contains(&of(scanner).unwrap_or_else(|| panic!("refused: {scanner}")).1, &[warning]);
    }
}

#[test]
fn what_xml_says_twice_or_beside_its_elements_is_warned_of() {
    let text = survey(&format!("{}>", OPTICS[0]), "type='linearpath'>", "", "", &legs("", ""));
    let part = "<filter type='objloader'><param type='string' key='filepath' value='a.obj'/></filter>";
    let with = |old: &str, new: &str| {
        let changed = text.replacen(old, new, 1);
        assert_ne!(changed, text, "{old}");
        read(&changed).unwrap_or_else(|| panic!("refused: {changed}")).1
    };
    contains(
        &with("</scene>", &format!("<part id='7'>{part}</part><part id='7'>{part}</part></scene>")),
        &["a second <part> has the id `7`: outputs cannot tell them apart"],
    );
    contains(&with("</part>", "scale 3</part>"), &["text in <part> is ignored: `scale 3`"]);
    contains(
        &with("</part>", "filter type='scale'><param type='double' key='scale' value='3'/></part>"),
        &["text in <part> is ignored: `filter type='scale'>`", "did an element lose its `<`?"],
    );
    contains(
        &with("</part>", "<swap force_null='maybe'/></part>"),
        &["`force_null` removes the part whatever its value"],
    );
    contains(
        &with(
            "</part>",
            "<dmotion id='m' loop='0'><motion type='translation' vec='1;0;0'/></dmotion></part>",
        ),
        &["this part moves at every pulse"],
    );
    contains(
        &with("<scene id='scene'>", "<scene id='scene' dynStep='0'>"),
        &["`dynStep` is 0: it never happens"],
    );
    contains(&with("x='0'", "x='0' y='3'"), &["`z` of the platform is missing; 0 is used"]);
    let channels = "<channels><channel id='a'/><channel id='a'/></channels>";
    let text = survey(&format!("{}>{channels}", OPTICS[0]), "type='linearpath'>", "", "", &legs("", ""));
    contains(&read(&text).unwrap().1, &["a second <channel> has the id `a`"]);
}

#[test]
fn messages_about_pipelines_name_their_keys() {
    use crate::named_as_in;
    use vlscan_base::diag::Place;
    let text = "set movePerSec_m above 0, or the scanner's `headRotatePerSecMax_deg` (x)";
    let of = |name: &str| named_as_in(Some(&Place::of_file(Path::new(name))), text);
    assert_eq!((of("s.xml").as_str(), named_as_in(None, text).as_str()), (text, text));
    assert_eq!(of("s.toml"), "set speed_m_per_s above 0, or the scanner's `head_rate_max_deg_per_s` (x)");
}
