//! Kinds that take more than a comparison of the first bytes: roots of XML, keys of JSON, entries of
//! archives, records, and statements and columns of text.

use super::kinds::{self, Kind};
use crate::columns::Separator;
use memchr::memmem::find;
use std::borrow::Cow;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Number of bytes of a record of SBET: 17 numbers of 64 bits (Applanix, POSPac).
pub(super) const SBET_BYTES: usize = 136;

/// A beginning of this length is that of its kind, though a number in binary data might begin so.
const SURE_BYTES: usize = 4;

/// The kind of a file that begins with `bytes`; one of the general kinds if none is known.
pub(super) fn kind_of(bytes: &[u8]) -> &'static Kind {
    if bytes.is_empty() {
        return &kinds::EMPTY;
    }
    let is_text = is_text(bytes);
    let start = of_start(bytes, is_text);
    // The low bytes of a time can be the few that compressed files begin with.
    if !is_text && start.is_none_or(|(_, length)| length < SURE_BYTES) && is_sbet(bytes) {
        return &kinds::SBET;
    }
    if let Some((kind, _)) = start {
        return of_container(kind, bytes);
    }
    if let Some(text) = of_utf16(bytes) {
        // The declaration and the root of XML identify it in every encoding.
        return if text.starts_with(b"<") { of_xml(&text) } else { &kinds::UTF16 };
    }
    if !is_text {
        return of_binary(bytes);
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    match text.first() {
        None => &kinds::EMPTY,
        Some(b'<') => of_xml(text),
        Some(b'{' | b'[') if is_json(text) => of_json(text),
        Some(_) => of_text(text),
    }
}

/// True if the bytes have no control characters but blanks and ends of lines.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    !bytes.iter().any(|b| *b < 0x20 && !matches!(b, b'\t' | b'\n' | b'\r' | 0x0b | 0x0c))
}

/// Beginnings of few letters that no text has.
const SURE: [&[u8]; 2] = [b"LASF", b"%PDF"];

/// The kind of the first bytes, and their number. Beginnings of few letters, which text may have by chance,
/// count in binary data only, but for those of [`SURE`].
fn of_start(bytes: &[u8], is_text: bool) -> Option<(&'static Kind, usize)> {
    let is_word = |start: &[u8]| start.len() < 5 && start.iter().all(|b| (0x20..0x7f).contains(b));
    let agrees =
        |start: &&&[u8]| bytes.starts_with(start) && !(is_text && is_word(start) && !SURE.contains(start));
    kinds::BY_START.iter().find_map(|kind| kind.starts.iter().find(agrees).map(|start| (kind, start.len())))
}

/// The kind within a general one: what an archive, a database or LAS contains.
fn of_container(kind: &'static Kind, bytes: &[u8]) -> &'static Kind {
    let holds = |word: &[u8]| find(bytes, word).is_some();
    let at = |at: usize, word: &[u8]| bytes.get(at..).is_some_and(|rest| rest.starts_with(word));
    if kind.name == kinds::ZIP.name {
        return of_zip(bytes);
    }
    if kind.name == kinds::SQLITE.name {
        // The application's number in the header of the database (GeoPackage 1.0 to 1.4, requirement 2).
        return match () {
            () if at(68, b"GP10") || at(68, b"GP11") || at(68, b"GPKG") => &kinds::GPKG,
            () if holds(b"topics") && holds(b"messages") => &kinds::ROS2,
            () => kind,
        };
    }
    if kind.name == kinds::STEP.name && holds(b"IFC") {
        return &kinds::IFC_MODEL;
    }
    if bytes.starts_with(b"LASF") {
        // The first record of COPC (COPC 1.0), and the bit of compressed points.
        return match bytes.get(104) {
            _ if at(377, b"copc") => &kinds::COPC,
            Some(format) if format & 0x80 != 0 => &kinds::LAZ,
            _ => kind,
        };
    }
    kind
}

/// By the names of the first entries, which are not compressed.
fn of_zip(bytes: &[u8]) -> &'static Kind {
    let holds = |word: &[u8]| find(bytes, word).is_some();
    let name = bytes.get(30..).unwrap_or_default();
    let length = bytes.get(26..28).map_or(0, |two| usize::from(u16::from_le_bytes([two[0], two[1]])));
    let name = String::from_utf8_lossy(&name[..name.len().min(length)]).to_ascii_lowercase();
    match () {
        () if name == "mimetype" && holds(b"opendocument.spreadsheet") => &kinds::ODS,
        () if name == "mimetype" => &kinds::OFFICE,
        () if holds(b"xl/") && holds(b"Content_Types") => &kinds::EXCEL,
        () if holds(b"3dmodel.model") => &kinds::PRINT,
        () if name == "[content_types].xml" && holds(b"word/") => &kinds::OFFICE,
        () if name == "[content_types].xml" => &kinds::EXCEL,
        () if name.ends_with(".kml") => &kinds::KMZ,
        () if name.ends_with(".npy") => &kinds::NPZ,
        () if name.ends_with(".usdc") || name.ends_with(".usda") => &kinds::USDZ,
        () => &kinds::ZIP,
    }
}

/// The ASCII letters of text in UTF-16 with a byte order mark.
fn of_utf16(bytes: &[u8]) -> Option<Cow<'_, [u8]>> {
    let low = match bytes {
        [0xff, 0xfe, ..] => 0,
        [0xfe, 0xff, ..] => 1,
        _ => return None,
    };
    let letters: Vec<u8> = bytes[2..].iter().skip(low).step_by(2).copied().collect();
    Some(letters.trim_ascii_start().to_vec().into())
}

fn of_binary(bytes: &[u8]) -> &'static Kind {
    let at = |at: usize, word: &[u8]| bytes.get(at..).is_some_and(|rest| rest.starts_with(word));
    match () {
        () if is_ply(bytes) => &kinds::PLY,
        () if first_word(bytes) == b"# .PCD" || is_pcd(bytes) => &kinds::PCD,
        // The programs that write them put names and comments before the first number.
        () if bytes.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) => &kinds::STL,
        () if at(257, b"ustar") => &kinds::TAR,
        () if is_dbf(bytes) => &kinds::DBF,
        () if is_3ds(bytes) => &kinds::STUDIO,
        () if is_off(bytes) => &kinds::OFF,
        () => &kinds::BINARY,
    }
}

/// The main chunk with its length, and in it the chunk of the version or of the objects.
fn is_3ds(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MM") && matches!(bytes.get(6..8), Some([0x02, 0x00] | [0x3d, 0x3d]))
}

/// The version, the date, and the lengths of header and record (dBASE III to 7).
fn is_dbf(bytes: &[u8]) -> bool {
    let Some(&[version, _, month, day, _, _, _, _, low, high, ..]) = bytes.first_chunk::<32>() else {
        return false;
    };
    let header = u16::from_le_bytes([low, high]);
    matches!(version, 0x03 | 0x04 | 0x30 | 0x31 | 0x83 | 0x8b | 0xf5)
        && (1..=12).contains(&month)
        && (1..=31).contains(&day)
        && header >= 65
        && (header % 32 < 2 || header % 32 == 8)
}

/// True if the bytes are plausible as the first record of an SBET trajectory.
pub fn is_sbet(bytes: &[u8]) -> bool {
    let Some(record) = bytes.first_chunk::<SBET_BYTES>() else { return false };
    let number = |i: usize| f64::from_le_bytes(std::array::from_fn(|b| record[8 * i + b]));
    let angles = (7..11).map(number);
    // Zeros are plausible anywhere and prove nothing.
    (1e-3..1e10).contains(&number(0))
        && number(1).abs() <= FRAC_PI_2
        && number(2).abs() <= TAU
        && (-1e4..1e6).contains(&number(3))
        && (4..7).map(number).all(|speed| speed.abs() < 1e5)
        && angles.into_iter().all(|angle| angle.abs() <= 2.0 * TAU)
}

/// By the root element, with any prefix.
fn of_xml(text: &[u8]) -> &'static Kind {
    let root = root_of(text);
    let holds = |word: &[u8]| find(text, word).is_some();
    match root.to_ascii_lowercase().as_slice() {
        // Metashape's projects have the same root.
        b"document" if holds(b"<chunks") || holds(b".files/") => &kinds::XML,
        b"document" => &kinds::DOCUMENT,
        b"collada" => &kinds::COLLADA,
        b"x3d" => &kinds::X3D,
        b"citymodel" => &kinds::CITYGML,
        b"landxml" => &kinds::LANDXML,
        b"ifcxml" => &kinds::IFC_MODEL,
        b"kml" => &kinds::KML,
        b"gpx" => &kinds::GPX,
        b"featurecollection" if holds(b"citygml") => &kinds::CITYGML,
        b"featurecollection" | b"feature" => &kinds::GML,
        b"osm" => &kinds::OSM,
        b"opendrive" => &kinds::OPENDRIVE,
        b"trainingcenterdatabase" => &kinds::TCX,
        b"vrtdataset" => &kinds::VRT,
        b"vtkfile" => &kinds::VTK_XML,
        b"html" => &kinds::HTML,
        b"svg" => &kinds::SVG,
        b"sdf" | b"robot" | b"mujoco" | b"world" | b"scene" => &kinds::ROBOT,
        _ if holds(b"opengis.net/gml") => &kinds::GML,
        _ => &kinds::XML,
    }
}

/// The local name of the first element.
fn root_of(text: &[u8]) -> &[u8] {
    let mut rest = text;
    loop {
        let Some(at) = memchr::memchr(b'<', rest) else { return b"" };
        rest = &rest[at + 1..];
        let end: &[u8] = match rest {
            [b'?', ..] => b"?>",
            [b'!', b'-', b'-', ..] => b"-->",
            [b'!', ..] if rest.get(..13).is_some_and(|word| word.eq_ignore_ascii_case(b"!DOCTYPE html")) => {
                return b"html";
            }
            [b'!', ..] => b">",
            _ => {
                let is_end = |b: &u8| b.is_ascii_whitespace() || matches!(b, b'>' | b'/');
                let name = rest.split(is_end).next().unwrap_or_default();
                return name.rsplit(|b| *b == b':').next().unwrap_or_default();
            }
        };
        let Some(at) = find(rest, end) else { return b"" };
        rest = &rest[at + end.len()..];
    }
}

/// True if the text begins as an object or a list of JSON does, and not as a heading or a table of TOML.
fn is_json(text: &[u8]) -> bool {
    let inner = text[1..].trim_ascii_start();
    let begins_value = |b: &u8| b.is_ascii_digit() || b"{[\"-".contains(b);
    text[0] == b'{' || !is_toml(text) && inner.first().is_none_or(begins_value)
}

/// By keys that only files of a kind have.
fn of_json(text: &[u8]) -> &'static Kind {
    let holds = |key: &str| find(text, format!("\"{key}\"").as_bytes()).is_some();
    match () {
        () if holds("CityJSON") || holds("CityJSONFeature") => &kinds::CITYJSON,
        () if holds("beam_altitude_angles") || holds("beam_intrinsics") => &kinds::OUSTER,
        () if holds("nbformat") || holds("cell_type") => &kinds::NOTEBOOK,
        () if holds("geometricError") || holds("hierarchyType") || holds("octreeDir") => &kinds::CLOUD_TILES,
        () if holds("hierarchy") && holds("spacing") && holds("points") => &kinds::CLOUD_TILES,
        () if holds("Topology") && holds("arcs") => &kinds::TOPOJSON,
        () if ["FeatureCollection", "Feature", "GeometryCollection"].iter().any(|name| holds(name)) => {
            &kinds::GEOJSON
        }
        () if holds("coordinates") && holds("type") => &kinds::GEOJSON,
        () if holds("asset") && ["meshes", "scenes", "nodes", "version"].iter().any(|name| holds(name)) => {
            &kinds::GLTF
        }
        () if holds("accessors") || holds("bufferViews") => &kinds::GLTF,
        () => &kinds::JSON,
    }
}

/// Words by which lines of text are recognised.
fn of_text(text: &[u8]) -> &'static Kind {
    let upper = text[..text.len().min(64)].to_ascii_uppercase();
    let starts = |words: &[&str]| words.iter().any(|word| upper.starts_with(word.as_bytes()));
    if is_ply(text) {
        return &kinds::PLY;
    }
    if text.starts_with(b"# .PCD") || is_pcd(text) {
        return &kinds::PCD;
    }
    if text.starts_with(b"#!/") {
        return if find(&text[..text.len().min(64)], b"python").is_some() {
            &kinds::PROGRAM
        } else {
            &kinds::SCRIPT
        };
    }
    if is_ascii_grid(text) {
        return &kinds::ESRI_GRID;
    }
    if starts(&[
        "PROJCS[",
        "PROJCRS[",
        "GEOGCS[",
        "GEOGCRS[",
        "COMPD_CS[",
        "COMPOUNDCRS[",
        "BOUNDCRS[",
        "LOCAL_CS[",
        "ENGCRS[",
        "GEODCRS[",
        "PROJECTEDCRS[",
    ]) {
        return &kinds::PRJ;
    }
    if is_wkt(&upper) {
        return &kinds::WKT;
    }
    if let Some(kind) = of_receiver(text) {
        return kind;
    }
    let mut lines = text.split(|b| matches!(b, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let first = lines.clone().find(|line| !(line.is_empty() || line.starts_with(b"#"))).unwrap_or_default();
    let word = first.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    match word {
        b"newmtl" => return &kinds::MTL,
        b"mtllib" | b"usemtl" | b"vn" | b"vt" | b"vp" if first.len() > word.len() => return &kinds::OBJ,
        b"v" | b"f" if has_numbers(first) => return &kinds::OBJ,
        b"o" | b"g" | b"s" if lines.any(|line| line.starts_with(b"v ") && has_numbers(line)) => {
            return &kinds::OBJ;
        }
        b"0" if find(&upper, b"SECTION").is_some() => return &kinds::DXF,
        word if word.eq_ignore_ascii_case(b"solid") => return &kinds::STL,
        b"def" | b"class" if first.ends_with(b":") => return &kinds::PROGRAM,
        b"import" if is_import(first) => return &kinds::PROGRAM,
        b"from" if find(first, b" import ").is_some() => return &kinds::PROGRAM,
        _ if is_off(first) => return &kinds::OFF,
        _ => {}
    }
    if is_toml(text) {
        return &kinds::PIPELINE;
    }
    if is_table(text) { &kinds::TABLE } else { &kinds::TEXT }
}

/// Logs of satellite receivers, by their first line: NMEA 0183 (`$GPGGA,`), IGC (a record `A`, and the date),
/// RINEX.
fn of_receiver(text: &[u8]) -> Option<&'static Kind> {
    let first = text.split(|b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default();
    let is_sentence = first.len() > 6
        && first[0] == b'$'
        && first[1..6].iter().all(u8::is_ascii_uppercase)
        && first[6] == b',';
    let is_igc = first.len() >= 4
        && first[0] == b'A'
        && first[1..4].iter().all(u8::is_ascii_alphanumeric)
        && find(text, b"\nHFDTE").is_some();
    match () {
        () if is_sentence => Some(&kinds::NMEA),
        () if is_igc => Some(&kinds::IGC),
        () if find(first, b"RINEX VERSION / TYPE").is_some() => Some(&kinds::RINEX),
        () => None,
    }
}

/// True for well-known text of a geometry (OGC 06-103r4, section 7), in capitals: `POLYGON Z ((`, `POINT
/// EMPTY`.
fn is_wkt(text: &[u8]) -> bool {
    const GEOMETRIES: [&[u8]; 7] = [
        b"POLYGON",
        b"LINESTRING",
        b"MULTIPOLYGON",
        b"MULTILINESTRING",
        b"GEOMETRYCOLLECTION",
        b"POINT",
        b"MULTIPOINT",
    ];
    let system = text.strip_prefix(b"SRID=").and_then(|rest| {
        let end = rest.iter().position(|b| !b.is_ascii_digit())?;
        rest[end..].strip_prefix(b";").filter(|_| end > 0)
    });
    let text = system.unwrap_or(text).trim_ascii_start();
    GEOMETRIES.iter().filter_map(|name| text.strip_prefix(*name)).any(|rest| {
        let rest = rest.trim_ascii_start();
        let dimensions: [&[u8]; 3] = [b"ZM", b"Z", b"M"];
        let inner = dimensions.iter().find_map(|dimension| rest.strip_prefix(*dimension)).unwrap_or(rest);
        let inner = inner.trim_ascii_start();
        inner.starts_with(b"(") || inner.starts_with(b"EMPTY")
    })
}

/// True for `import` of Python with names of modules behind it.
fn is_import(line: &[u8]) -> bool {
    let is_name = |b: &u8| b.is_ascii_alphanumeric() || b"_., ".contains(b);
    let names = line.strip_prefix(b"import").unwrap_or_default().trim_ascii();
    let words = || names.split(|b| b" ,".contains(b)).filter(|word| !word.is_empty());
    let is_list = names.contains(&b',') || words().count() == 1 || words().nth(1) == Some(b"as");
    !names.is_empty() && names.iter().all(is_name) && is_list
}

fn first_word(bytes: &[u8]) -> &[u8] {
    &bytes[..bytes.len().min(6)]
}

/// True if all words behind the first one are numbers, and there are at least three: `v 1 2 3`, `f 1/1 2/2
/// 3/3`.
fn has_numbers(line: &[u8]) -> bool {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).skip(1).peekable();
    let is_number = |word: &[u8]| word.iter().all(|b| b.is_ascii_digit() || b"+-.eE/".contains(b));
    words.clone().count() >= 3 && words.all(is_number)
}

/// PLY, whose first line is a word.
pub(super) fn is_ply(bytes: &[u8]) -> bool {
    matches!(bytes, [b'p', b'l', b'y', b'\r' | b'\n' | b' ' | b'\t', ..])
}

/// PCD, which may begin with comments.
fn is_pcd(bytes: &[u8]) -> bool {
    let mut lines = bytes.split(|b| matches!(b, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let line = lines.find(|line| !(line.is_empty() || line.starts_with(b"#"))).unwrap_or_default();
    let mut words = line.split(|b| b" \t".contains(b));
    // A heading of a table may be `VERSION;...`.
    matches!(words.next(), Some(b"VERSION" | b"FIELDS" | b"COLUMNS")) && words.next().is_some()
}

/// True if the first word is that of OFF, or of a variant with colours, normals, textures or dimensions
/// (Geomview's manual, "OFF Files"). Numbers may follow it without a blank, as in ModelNet.
pub fn is_off(bytes: &[u8]) -> bool {
    let mut lines = bytes.split(|b| matches!(b, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let line = lines.find(|line| !(line.is_empty() || line.starts_with(b"#"))).unwrap_or_default();
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let word = words.next().unwrap_or_default();
    let word = word[..word.len().min(16)].to_ascii_uppercase();
    let Some(at) = find(&word, b"OFF") else { return false };
    // The counts may follow, in the line of a heading that begins with such a word names do.
    let is_count = |word: &[u8]| word.iter().all(u8::is_ascii_digit);
    words.take_while(|word| !word.starts_with(b"#")).all(|word| word == b"BINARY" || is_count(word))
        && word[..at].len() <= 5
        && word[..at].iter().all(|b| b"STCN4".contains(b))
        && word[at + 3..].iter().all(u8::is_ascii_digit)
}

/// True if the bytes begin as an ESRI ASCII grid does: with two of its keys in two lines.
pub fn is_ascii_grid(bytes: &[u8]) -> bool {
    const KEYS: [&[u8]; 9] = [
        b"ncols",
        b"nrows",
        b"xllcorner",
        b"yllcorner",
        b"xllcenter",
        b"yllcenter",
        b"cellsize",
        b"dx",
        b"nodata_value",
    ];
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let lines = text.split(|b| matches!(b, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let mut lines = lines.filter(|line| !line.is_empty());
    let mut is_key = || {
        let mut words =
            lines.next().unwrap_or_default().split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let key = words.next().unwrap_or_default();
        let is_one = words.clone().count() == 1;
        is_one && KEYS.iter().any(|known| key.eq_ignore_ascii_case(known))
    };
    is_key() && is_key()
}

/// A table in brackets, or a key with a value, as the first statement; a number as the value tells only if a
/// second statement follows, since tables may have such lines above their heading.
fn is_toml(text: &[u8]) -> bool {
    let lines = text.split(|b| *b == b'\n').map(<[u8]>::trim_ascii);
    let mut lines = lines.filter(|line| !(line.is_empty() || line.starts_with(b"#")));
    let first = lines.next().unwrap_or_default();
    let is_number = first.rsplit(|b| *b == b'=').next().is_some_and(|value| {
        value.trim_ascii().first().is_some_and(|b| b.is_ascii_digit() || b"+-".contains(b))
    });
    is_statement(first)
        && (!is_number || lines.next().is_none_or(|second| second.starts_with(b"[") || is_statement(second)))
}

/// True for a line of TOML: a table in brackets, or a key with a value.
fn is_statement(first: &[u8]) -> bool {
    let is_name = |b: &u8| b.is_ascii_alphanumeric() || b"_-.".contains(b);
    if let Some(inner) = first.strip_prefix(b"[") {
        let inner = inner.strip_prefix(b"[").unwrap_or(inner);
        let end = inner.iter().position(|b| !is_name(b)).unwrap_or(0);
        let rest = inner[end..].trim_ascii_start();
        let rest = rest.strip_prefix(b"]").map(|rest| rest.strip_prefix(b"]").unwrap_or(rest).trim_ascii());
        return end > 0
            && !inner[0].is_ascii_digit()
            && rest.is_some_and(|rest| rest.is_empty() || rest[0] == b'#');
    }
    let Some((key, value)) = first.iter().position(|b| *b == b'=').map(|at| first.split_at(at)) else {
        return false;
    };
    let (key, value) = (key.trim_ascii(), value[1..].trim_ascii());
    let is_value = value.first().is_some_and(|b| b"\"'[{+-".contains(b) || b.is_ascii_digit())
        || matches!(value, b"true" | b"false");
    !key.is_empty() && key.iter().all(is_name) && is_value
}

/// Columns of numbers, below at most one line of names.
fn is_table(text: &[u8]) -> bool {
    let lines = text.split(|b| matches!(b, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let mut lines =
        lines.filter(|line| !(line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//"))).take(3);
    let numbers = |line: &[u8]| {
        let separator = Separator::guess(line);
        let (mut all, mut numbers) = (0, 0);
        for at in separator.split(line) {
            let field = line[at].iter().map(|b| if *b == b',' { b'.' } else { *b }).collect::<Vec<_>>();
            let number = std::str::from_utf8(&field)
                .ok()
                .and_then(|field| field.trim_matches('"').parse::<f64>().ok());
            (all, numbers) = (all + 1, numbers + usize::from(number.is_some()));
        }
        (separator, all, numbers)
    };
    let Some((separator, columns, count)) = lines.next().map(numbers) else { return false };
    if count >= 2 && 2 * count >= columns {
        return true;
    }
    // A heading; words between blanks are prose unless numbers follow.
    let has_rows = lines.next().map(numbers).is_some_and(|(_, _, count)| count >= 2);
    columns >= 2 && (has_rows || columns >= 3 && separator != Separator::Blanks && text.len() < 4096)
}
