//! Extraction of the EPSG code of a coordinate reference system.

/// Kind of system that an EPSG code denotes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EpsgKind {
    Projected,
    Geographic,
}

/// Returns the code of a projected or geographic system in WKT 1 or 2. The code of the system as such is its last
/// element.
pub(super) fn epsg(wkt: &str) -> Option<(EpsgKind, u16)> {
    let keyword = wkt.trim_start().split(['[', '(']).next()?.trim().to_ascii_uppercase();
    let kind = match keyword.as_str() {
        "PROJCS" | "PROJCRS" | "PROJECTEDCRS" => EpsgKind::Projected,
        "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS" => EpsgKind::Geographic,
        _ => return None,
    };
    let compact: String = wkt.chars().filter(|c| !c.is_whitespace() && *c != '\0').collect();
    let body = compact.strip_suffix("]]").or(compact.strip_suffix("))"))?;
    let last = body.rsplit(['[', '(']).next()?;
    let (authority, code) = last.split_once(',')?;
    let code = code.trim_matches('"').parse().ok()?;
    authority.eq_ignore_ascii_case("\"EPSG\"").then_some((kind, code))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_code_of_the_whole_system_counts() {
        let one = r#"PROJCS["ETRS89 / UTM 32N",GEOGCS["ETRS89",AUTHORITY["EPSG","4258"]],AUTHORITY["EPSG","25832"]]"#;
        assert_eq!(epsg(one), Some((EpsgKind::Projected, 25832)));
        let two = "GEOGCRS[\"WGS 84\",\n  DATUM[\"World\"],\n  ID[\"EPSG\",4326]]\0";
        assert_eq!(epsg(two), Some((EpsgKind::Geographic, 4326)));
        let inner = r#"PROJCS["mine",GEOGCS["ETRS89",AUTHORITY["EPSG","4258"]],UNIT["metre",1]]"#;
        assert_eq!(epsg(inner), None);
        assert_eq!(epsg(r#"COMPD_CS["both",AUTHORITY["EPSG","5555"]]"#), None);
        assert_eq!(epsg(""), None);
    }
}
