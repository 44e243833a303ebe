//! Fog, rain, snow and dust along the beam, as pipeline files state them.

use super::fields::Fields;
use super::keys::{SettingsKeys, WeatherKeys};
use super::rows::{MAX_FILE_BYTES, RowLayout, RowProblem, read_rows};
use super::{AirState, Weather};
use vlscan_base::quantity::{DUST, OPTICAL_RANGE, RAIN_RATE, SNOW_RATE, TIME};

/// Applies the keys of `weather`; those of a leg override those of all legs.
pub(super) fn change_weather(fields: &mut Fields, weather: &mut Weather) {
    let Some(mut table) = fields.child(SettingsKeys::KEYS.weather, &WeatherKeys::TABLE) else { return };
    let keys = WeatherKeys::KEYS;
    table.either(keys.mor_m, keys.visibility_km);
    let constant = [keys.mor_m, keys.rain_mm_h, keys.snow_mm_h, keys.dust];
    constant.into_iter().for_each(|key| table.either(keys.over_time, key));
    if constant.into_iter().any(|key| table.has(key)) {
        weather.over_time = None;
    }
    if let Some(visibility) = table.optional(keys.visibility_km) {
        (weather.visibility, weather.air.fog) = (Some(visibility), 0.0);
    }
    if let Some(range) = table.optional(keys.mor_m) {
        weather.air.fog = AirState::fog_of_range(range);
    }
    table.set(keys.rain_mm_h, &mut weather.air.rain);
    table.set(keys.snow_mm_h, &mut weather.air.snow);
    table.set(keys.dust, &mut weather.air.dust);
    table.set(keys.lidar_ratio_sr, &mut weather.lidar_ratio);
    table.set(keys.drop_factor, &mut weather.drop_factor);
    if let Some(name) = table.near_name(keys.over_time)
        && let Some(rows) = read_weather(&table, &name)
    {
        if table.has(keys.visibility_km) && rows.iter().any(|(_, air)| air.fog > 0.0) {
            let message =
                format!("`visibility_km` has no effect: the fog of `{name}` takes the place of haze");
            table.context.warn_help(table.place(keys.visibility_km), message, "");
        }
        (weather.over_time, weather.air) = (Some(rows.into()), AirState::default());
    }
    table.done(&[]);
}

/// Lines of a time, s, ascending, and the weather at that time.
fn read_weather(fields: &Fields, name: &str) -> Option<Vec<(f64, AirState)>> {
    let mut rows: Vec<(f64, AirState)> = Vec::new();
    let row = |&[time, range, rain, snow, dust]: &[f64; 5]| {
        if !TIME.contains(time) || rows.last().is_some_and(|last| time <= last.0) {
            return Err(RowProblem::NotLater);
        }
        if range != 0.0 && !OPTICAL_RANGE.contains(range) {
            return Err(RowProblem::Weather("a meteorological optical range of 0.1 to 1e9 m, or 0"));
        }
        for (bounds, value) in [(RAIN_RATE, rain), (SNOW_RATE, snow), (DUST, dust)] {
            if !bounds.contains(value) {
                return Err(RowProblem::Weather(bounds.expected));
            }
        }
        let fog = if range == 0.0 { 0.0 } else { AirState::fog_of_range(range) };
        rows.push((time, AirState { fog, rain, snow, dust }));
        Ok(())
    };
    let place = fields.place(WeatherKeys::KEYS.over_time);
    let columns = "five finite numbers: GPS time in s, mor_m, rain_mm_h, snow_mm_h and dust";
    let help = "a line is, for example, `86418, 0, 10, 0, 0`: rain of 10 mm/h without fog";
    let format = RowLayout { columns, help, headings: ["time_s", "mor_m", "rain_mm_h", "snow_mm_h", "dust"] };
    read_rows(fields.context, name, (fields.folder(), MAX_FILE_BYTES), &place, &format, row)?;
    if rows.is_empty() {
        fields.context.error_help(place, format!("`{name}` has no line of numbers"), help);
        return None;
    }
    Some(rows)
}
