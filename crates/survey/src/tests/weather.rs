//! Weather of pipeline files.

use super::*;

/// The weather of the legs of a pipeline with these keys for all legs and for the first one.
fn read(common: &str, own: &str) -> vlscan_base::Result<(Vec<Weather>, Diagnostics)> {
    let text = format!(
        "scene = \"a.obj\"\n[platform]\nkind = \"linear_path\"\n[scanner]\noptics = \"conic\"\nscan_angle_max_deg = 30\npulse_freqs_hz = [5000]\n\
         [settings]\nscan_freq_hz = 1\nweather = {{ {common} }}\n[[leg]]\nposition_m = [0, 0, 0]\nspeed_m_per_s = 70\n[leg.settings]\n{own}\n\
         [[leg]]\nposition_m = [5, 0, 0]\nactive = false\n"
    );
    let files = [
        ("p.toml", text.as_str()),
        ("a.obj", ""),
        ("w.csv", "time_s,mor_m,rain_mm_h,snow_mm_h,dust\n10,100,0,0,0\n20,0,5,1,0.5\n"),
        ("rain.csv", "10 0 5 0 0\n"),
        ("back.csv", "10 100 0 0 0\n10 100 0 0 0\n"),
        ("dry.csv", "10 100 -1 0 0\n"),
        ("thick.csv", "10 0.01 0 0 0\n"),
        ("few.csv", "10 100\n"),
        ("empty.csv", "# nothing\n"),
        ("swapped.csv", "time_s,dust,rain_mm_h,snow_mm_h,mor_m\n10,0.5,0,0,0\n"),
        ("ms.csv", "time_ms,mor_m,rain_mm_h,snow_mm_h,dust\n10,0,5,0,0\n"),
    ];
    let folder = Folder::new(&files);
    let read = read_pipeline(&folder.path("p.toml"));
    read.map(|(survey, warnings)| {
        (survey.legs.into_iter().map(|leg| leg.scanner.weather).collect(), warnings)
    })
}

fn weather(common: &str, own: &str) -> Vec<Weather> {
    let (legs, warnings) = read(common, own).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(warnings.is_empty(), "{}", warnings.render(false));
    legs
}

#[test]
fn legs_change_the_keys_of_the_weather_that_they_name() {
    let legs = weather("mor_m = 100, rain_mm_h = 10, lidar_ratio_sr = 20", "weather = { rain_mm_h = 2 }");
    let fog = AirState::fog_of_range(100.0);
    assert_eq!(legs[1].air, AirState { fog, rain: 10.0, ..AirState::default() });
    assert_eq!(legs[0].air, AirState { fog, rain: 2.0, ..AirState::default() });
    assert!(legs.iter().all(|weather| weather.lidar_ratio == 20.0 && weather.drop_factor == 1.0));
    let legs = weather("mor_m = 100", "weather = { visibility_km = 5, dust = 0.001 }");
    assert_eq!((legs[0].haze_visibility(23.0), legs[1].haze_visibility(23.0)), (5.0, f64::INFINITY));
    assert_eq!(legs[0].air, AirState { dust: 0.001, ..AirState::default() });
    assert_eq!(weather("", ""), [Weather::CLEAR, Weather::CLEAR]);
}

#[test]
fn files_have_the_weather_over_time() {
    let legs = weather("over_time = \"w.csv\", drop_factor = 0.5", "weather = { snow_mm_h = 1 }");
    assert_eq!(legs[1].at(15.0).rain, 2.5);
    assert_eq!(legs[1].at(0.0).fog, AirState::fog_of_range(100.0));
    assert_eq!(legs[0].over_time, None);
    assert_eq!((legs[0].at(15.0).snow, legs[0].drop_factor), (1.0, 0.5));
    let (_, warnings) = read("over_time = \"w.csv\", visibility_km = 5", "").unwrap();
    assert!(warnings.text().contains("`visibility_km` has no effect: the fog of `"), "{}", warnings.text());
    assert!(read("over_time = \"rain.csv\", visibility_km = 5", "").unwrap().1.is_empty());
}

#[test]
fn weather_that_cannot_be_is_refused() {
    for (keys, message) in [
        ("mor_m = 100, visibility_km = 5", "give either `mor_m` or `visibility_km`, not both"),
        ("mor_m = 0", "`mor_m` must be metres from 0.1 to 1e9, found `0`"),
        ("mor_m = nan", "`mor_m` must be metres from 0.1 to 1e9, found `nan`"),
        ("mor_m = -5", "`mor_m` must be metres"),
        ("rain_mm_h = -1", "`rain_mm_h` must be a rate of 0 to 1000 mm/h, found `-1`"),
        ("rain_mm_h = inf", "`rain_mm_h` must be a rate"),
        ("snow_mm_h = nan", "`snow_mm_h` must be a rate of 0 to 200 mm/h of melted water, found `nan`"),
        ("dust = -0.5", "`dust` must be an extinction of 0 to 100 per metre, found `-0.5`"),
        ("lidar_ratio_sr = 0", "`lidar_ratio_sr` must be a lidar ratio"),
        ("drop_factor = -1", "`drop_factor` must be a factor of 0 to 1000"),
        ("rian_mm_h = 5", "rain_mm_h"),
        ("over_time = \"w.csv\", dust = 0.1", "give either `over_time` or `dust`"),
        ("over_time = \"back.csv\"", "a time later than that of the line before"),
        ("over_time = \"dry.csv\"", "a rate of 0 to 1000 mm/h"),
        ("over_time = \"thick.csv\"", "a meteorological optical range of 0.1 to 1e9 m, or 0"),
        ("over_time = \"few.csv\"", "five finite numbers"),
        ("over_time = \"empty.csv\"", "empty.csv` has no line of numbers"),
        ("over_time = \"swapped.csv\"", "expected `mor_m` as column 2, found `dust`"),
        ("over_time = \"ms.csv\"", "expected `time_s` as column 1, found `time_ms`"),
        ("over_time = \"none.csv\"", "cannot find the file `none.csv`"),
    ] {
        contains(&refused(read(keys, "")), &[message]);
    }
}
