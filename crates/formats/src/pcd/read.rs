//! PCD of the Point Cloud Library, 0.5 to 0.7: text, binary, and binary compressed by LZF. Points with
//! coordinates that are NaN, as organised clouds have them, are not points. The offset that this program
//! writes as a comment is added.

use super::PcdError;
use crate::text::{float, is_line_end, last_of_line_ends};
use crate::{Attribute, Columns, Reading};
use std::ops::ControlFlow;
use vlscan_base::columns::{Separator, is_blank};
use vlscan_geom::DVec3;

/// Maximum number of bytes to which LZF expands one byte.
const MAX_EXPANSION: usize = 132;

/// True if a file begins as PCD does: a line VERSION, FIELDS or COLUMNS after comments.
pub(crate) fn is_pcd(first: &[u8]) -> bool {
    let mut lines = first.split(|b| is_line_end(*b)).map(<[u8]>::trim_ascii);
    if first.starts_with(b"# .PCD") {
        return true;
    }
    let line = lines.find(|line| !(line.is_empty() || line.starts_with(b"#"))).unwrap_or_default();
    let word = line.split(|b| is_blank(*b)).next().unwrap_or_default();
    matches!(word, b"VERSION" | b"FIELDS" | b"COLUMNS")
}

/// A field of the points: `count` values of `size` bytes.
#[derive(Clone, Copy, Debug)]
struct Field {
    kind: u8,
    size: usize,
    count: usize,
    /// Offset in a record, bytes, and index of the first value.
    offset: usize,
    index: usize,
}

impl Field {
    /// The first value in the bytes of the field.
    fn value(&self, bytes: &[u8]) -> f64 {
        let array: [u8; 8] = std::array::from_fn(|i| if i < self.size { bytes[i] } else { 0 });
        let bits = u64::from_le_bytes(array);
        match (self.kind, self.size) {
            (b'F', 4) => f64::from(f32::from_bits(bits as u32)),
            (b'F', _) => f64::from_bits(bits),
            (b'I', size) => {
                let unused = 64 - 8 * size as u32;
                ((bits << unused) as i64 >> unused) as f64
            }
            _ => bits as f64,
        }
    }
}

/// How the points are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Ascii,
    Binary,
    Compressed,
}

/// A field with the colour of a point as 0xRRGGBB, below eight bits that do not count.
#[derive(Clone, Copy, Debug)]
struct PackedColour {
    field: usize,
    /// True if text has the number whose bits as a 32-bit float are the colour, as the Point Cloud Library
    /// writes it.
    is_float: bool,
}

impl PackedColour {
    /// The first field with one of the usual names.
    fn find(names: &[String], fields: &[Field]) -> Option<PackedColour> {
        let is_colour = |name: &String| name.eq_ignore_ascii_case("rgb") || name.eq_ignore_ascii_case("rgba");
        let is_packed = |field: &Field| field.count == 1 && field.size == 4;
        let field = names.iter().zip(fields).position(|(name, field)| is_colour(name) && is_packed(field))?;
        Some(PackedColour { field, is_float: fields[field].kind == b'F' })
    }

    /// The bits of a number in text, as a number. Those of NaN are not known.
    fn bits(self, number: f64) -> f64 {
        match self.is_float {
            _ if number.is_nan() => 0.0,
            true => f64::from((number as f32).to_bits()),
            false => number,
        }
    }

    /// Red, green and blue of the bits.
    fn colour(bits: f64) -> [u16; 3] {
        // The conversion wraps negative numbers of signed fields, and NaN becomes 0.
        let bits = bits as i64 as u32;
        [16, 8, 0].map(|shift| (bits >> shift & 0xff) as u16)
    }
}

/// The header of a file.
struct Header {
    fields: Vec<Field>,
    /// Names of the fields; those of padding and of fields with several values are empty.
    names: Vec<String>,
    columns: Columns,
    /// Fields whose values are passed with the points.
    chosen: Vec<usize>,
    /// The colour of the points, if a field packs red, green and blue into one number.
    packed_colour: Option<PackedColour>,
    remarks: Vec<String>,
    points: usize,
    encoding: Encoding,
    offset: DVec3,
    /// True if this program has written the file.
    is_own: bool,
    /// Offset of the points in the file.
    data: usize,
}

impl Header {
    fn record_bytes(&self) -> usize {
        self.fields.iter().map(|field| field.size * field.count).sum()
    }

    fn read(bytes: &[u8]) -> Result<Header, PcdError> {
        let mut at = 0;
        let mut lists: [Vec<String>; 4] = Default::default();
        let (mut points, mut width, mut height) = (None, None, 1);
        let (mut offset, mut is_own) = (DVec3::ZERO, false);
        let line_end = last_of_line_ends(bytes);
        loop {
            let length = memchr::memchr(line_end, &bytes[at..]);
            let end = at + length.ok_or(PcdError::NoData)?;
            let line = String::from_utf8_lossy(&bytes[at..end]).into_owned();
            at = end + 1;
            let words: Vec<&str> = line.split_whitespace().collect();
            // A second word is not part of a number.
            let number = |keyword| {
                let word = words.get(1).filter(|_| words.len() == 2);
                word.and_then(|word| word.parse::<usize>().ok()).ok_or(PcdError::NotANumber { keyword })
            };
            let list = || words[1..].iter().map(|word| (*word).to_owned()).collect();
            match words.first().copied().unwrap_or_default() {
                "FIELDS" | "COLUMNS" => lists[0] = list(),
                "SIZE" => lists[1] = list(),
                "TYPE" => lists[2] = list(),
                "COUNT" => lists[3] = list(),
                "WIDTH" => width = Some(number("WIDTH")?),
                "HEIGHT" => height = number("HEIGHT")?,
                "POINTS" => points = Some(number("POINTS")?),
                "#" if words.get(1) == Some(&"vlscan") => is_own = true,
                "#" => offset = offset_of_comment(&words).unwrap_or(offset),
                "DATA" => {
                    let encoding = match words.get(1).copied() {
                        Some("ascii") => Encoding::Ascii,
                        Some("binary") => Encoding::Binary,
                        Some("binary_compressed") => Encoding::Compressed,
                        other => {
                            return Err(PcdError::Encoding { found: other.unwrap_or_default().to_owned() });
                        }
                    };
                    let raster = width.and_then(|width| width.checked_mul(height));
                    let differs = points.zip(raster).filter(|(points, raster)| points != raster);
                    let remark = differs.map(|(points, raster)| {
                        format!(
                            "its header has {points} POINTS, which are read, but WIDTH times HEIGHT is \
                             {raster}"
                        )
                    });
                    let points = points.or(raster);
                    let points = points.ok_or(PcdError::NoPoints)?;
                    let header = Header {
                        fields: Vec::new(),
                        names: Vec::new(),
                        columns: Columns::default(),
                        chosen: Vec::new(),
                        packed_colour: None,
                        remarks: Vec::new(),
                        points,
                        encoding,
                        offset,
                        is_own,
                        data: at,
                    };
                    let mut header = header.with_fields(&lists)?;
                    header.remarks.extend(remark);
                    return Ok(header);
                }
                _ => {}
            }
        }
    }

    fn with_fields(mut self, [names, sizes, kinds, counts]: &[Vec<String>; 4]) -> Result<Header, PcdError> {
        for (keyword, list) in [("SIZE", sizes), ("TYPE", kinds), ("COUNT", counts)] {
            if !list.is_empty() && list.len() != names.len() {
                let (fields, found) = (names.len(), list.len());
                return Err(PcdError::FieldCount { fields, found, keyword });
            }
        }
        let (mut offset, mut index) = (0usize, 0usize);
        for (i, name) in names.iter().enumerate() {
            let size = sizes.get(i).map_or(Some(4), |size| size.parse().ok());
            let kind = kinds.get(i).map_or(b'F', |kind| if kind.len() == 1 { kind.as_bytes()[0] } else { 0 });
            let count = counts.get(i).map_or(Some(1), |count| count.parse::<usize>().ok());
            let known = matches!((kind, size), (b'F', Some(4 | 8)) | (b'I' | b'U', Some(1 | 2 | 4 | 8)));
            let (Some(size), Some(count), true) = (size, count.filter(|c| *c < 1 << 20), known) else {
                return Err(PcdError::Field { name: name.clone() });
            };
            self.fields.push(Field { kind, size, count, offset, index });
            offset += size * count;
            index += count;
        }
        self.packed_colour = PackedColour::find(names, &self.fields);
        if let Some(colour) = self.packed_colour {
            // Its bits count, also those of a float that is NaN.
            self.fields[colour.field].kind = b'U';
        }
        // Padding is called "_"; fields of several values hold no attribute.
        let names: Vec<&str> = names
            .iter()
            .zip(&self.fields)
            .map(|(name, field)| if name == "_" || field.count != 1 { "" } else { name.as_str() })
            .collect();
        let columns = Columns::find_positions(&names)?;
        self.columns = columns.of_own_table(self.is_own);
        self.remarks = self.columns.remarks(&names);
        if let (Some(_), Some(packed)) = (self.columns.colours(), self.packed_colour) {
            let name = names[packed.field];
            self.remarks.push(format!("its colours are read from red, green and blue, not from {name}"));
        }
        self.names = names.into_iter().map(str::to_owned).collect();
        Ok(self)
    }
}

/// The offset in the comment "add X Y Z to x y z" of files of this program.
fn offset_of_comment(words: &[&str]) -> Option<DVec3> {
    let ["#", "add", x, y, z, "to", ..] = words else { return None };
    let number = |word: &str| word.parse::<f64>().ok().filter(|value| value.is_finite());
    Some(DVec3::new(number(x)?, number(y)?, number(z)?))
}

/// Reads a file.
pub(crate) fn read(bytes: &[u8], reading: &mut Reading) -> Result<(), PcdError> {
    let mut header = Header::read(bytes)?;
    header.remarks.iter().for_each(|remark| reading.warn(remark.as_str()));
    let has_colours = header.columns.colours().is_some() || header.packed_colour.is_some();
    reading.sink.start(header.columns.attributes().with_colours(has_colours));
    header.chosen = reading.choose(&header.names.iter().map(String::as_str).collect::<Vec<&str>>());
    let data = &bytes[header.data..];
    match header.encoding {
        Encoding::Ascii => read_text(data, &header, reading),
        Encoding::Binary => {
            let length = header.record_bytes();
            let held = data.len() / length.max(1);
            for (index, record) in data.chunks_exact(length.max(1)).take(header.points).enumerate() {
                reading.release_before(header.data + index * length);
                let value =
                    |column: usize| header.fields[column].value(&record[header.fields[column].offset..]);
                if push(&header, value, reading).is_break() {
                    return Ok(());
                }
            }
            if held > header.points {
                reading.warn_of_rest(header.points);
            }
            is_whole(held, header.points)
        }
        Encoding::Compressed => {
            let data = decompressed(data, &header)?;
            // All values of a field follow one another.
            for i in 0..header.points {
                let value = |column: usize| {
                    let field = &header.fields[column];
                    field.value(&data[field.offset * header.points + i * field.size * field.count..])
                };
                if push(&header, value, reading).is_break() {
                    break;
                }
            }
            Ok(())
        }
    }
}

fn push(header: &Header, value: impl Fn(usize) -> f64, reading: &mut Reading) -> ControlFlow<()> {
    let mut row = header.columns.row(&value);
    if let Some(PackedColour { field, .. }) = header.packed_colour
        && row.colour.is_none()
    {
        row.colour = Some(PackedColour::colour(value(field)));
    }
    if row.position.is_nan() {
        return ControlFlow::Continue(());
    }
    row.position += header.offset;
    let values: Vec<f64> = header.chosen.iter().map(|column| value(*column)).collect();
    reading.pass_values(&values);
    reading.take(&row)
}

fn read_text(data: &[u8], header: &Header, reading: &mut Reading) -> Result<(), PcdError> {
    let mut passed = 0;
    let used: Vec<(Attribute, usize)> = header.columns.used().collect();
    let mut more: Vec<usize> = match (header.columns.colours(), header.packed_colour) {
        (Some(columns), _) => columns.to_vec(),
        (None, packed) => packed.iter().map(|packed| packed.field).collect(),
    };
    let is_used = |column: &usize| used.iter().any(|(_, used)| used == column);
    more.extend(header.chosen.iter().copied().filter(|column| !is_used(column)));
    let mut values = vec![f64::NAN; header.fields.len()];
    let width: usize = header.fields.iter().map(|field| field.count).sum();
    let mut others = 0u64;
    let mut lines = data.split(|b| is_line_end(*b)).filter(|line| !line.trim_ascii().is_empty());
    for line in lines.by_ref().take(header.points) {
        let words: Vec<_> = Separator::Blanks.split(line).collect();
        others += u64::from(words.len() != width);
        for (attribute, column) in &used {
            let word = words.get(header.fields[*column].index).map_or(&b""[..], |at| &line[at.clone()]);
            values[*column] = float(word).ok_or_else(|| PcdError::Value {
                point: passed,
                expected: attribute.described(),
                found: String::from_utf8_lossy(word).into_owned(),
            })?;
        }
        for column in more.iter().copied() {
            let word = words.get(header.fields[column].index).map_or(&b""[..], |at| &line[at.clone()]);
            // These are not attributes: without a number a colour is black.
            let number = float(word).unwrap_or(f64::NAN);
            let packed = header.packed_colour.filter(|packed| packed.field == column);
            values[column] = packed.map_or(number, |packed| packed.bits(number));
        }
        passed += 1;
        if push(header, |column| values[column], reading).is_break() {
            return Ok(());
        }
    }
    if others > 0 {
        let lines = if others == 1 { "line has" } else { "lines have" };
        reading.warn(format!("{others} {lines} more or fewer values than the {width} of its FIELDS"));
    }
    if passed == header.points && lines.next().is_some() {
        reading.warn_of_rest(header.points);
    }
    is_whole(passed, header.points)
}

fn is_whole(held: usize, stated: usize) -> Result<(), PcdError> {
    match held < stated {
        true => Err(PcdError::Truncated { held, stated }),
        false => Ok(()),
    }
}

/// The decompressed points, as many as the header states.
fn decompressed(data: &[u8], header: &Header) -> Result<Vec<u8>, PcdError> {
    let size =
        |at: usize| data.get(at..at + 4).map(|b| u32::from_le_bytes(std::array::from_fn(|i| b[i])) as usize);
    let (Some(packed), Some(unpacked)) = (size(0), size(4)) else {
        return is_whole(0, 1).map(|()| Vec::new());
    };
    let packed = data.get(8..).and_then(|data| data.get(..packed));
    let packed = packed.ok_or(PcdError::CompressedPointsEnd)?;
    let expected = header.record_bytes().checked_mul(header.points);
    if expected != Some(unpacked) || unpacked / MAX_EXPANSION > packed.len() {
        return Err(PcdError::CompressedSize { points: header.points, bytes: unpacked });
    }
    lzf(packed, unpacked).ok_or(PcdError::Damaged)
}

/// Decompresses LZF: a byte n below 32 precedes n + 1 literals; others are references to earlier output,
/// whose length is in the upper three bits, with a further byte if they are 7, and whose distance is in the
/// rest and a byte.
fn lzf(packed: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut out: Vec<u8> = Vec::with_capacity(length);
    let mut rest = packed;
    while let Some((&control, behind)) = rest.split_first() {
        if control < 32 {
            let (literals, behind) = behind.split_at_checked(usize::from(control) + 1)?;
            out.extend_from_slice(literals);
            rest = behind;
        } else {
            rest = behind;
            let mut next = || {
                let (first, behind) = rest.split_first()?;
                rest = behind;
                Some(usize::from(*first))
            };
            let mut count = usize::from(control >> 5);
            if count == 7 {
                count += next()?;
            }
            let distance = (usize::from(control & 0x1f) << 8) + next()? + 1;
            let start = out.len().checked_sub(distance)?;
            (start..start + count + 2).for_each(|at| out.push(out[at]));
        }
        if out.len() > length {
            return None;
        }
    }
    (out.len() == length).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AttributeSet, PointRow, PointSink, read_points};
    use vlscan_base::error::Result;

    /// Takes the colours of points.
    #[derive(Default)]
    struct ColourSink(Vec<Option<[u16; 3]>>);

    impl PointSink for ColourSink {
        fn start(&mut self, _: AttributeSet) {}

        fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
            self.0.push(row.colour);
            Ok(ControlFlow::Continue(()))
        }
    }

    /// The colours of a file whose field `name` has 4 bytes of this kind.
    fn colours(name: &str, kind: char, points: usize, data: &[u8]) -> Vec<Option<[u16; 3]>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pcd");
        let head = format!(
            "VERSION 0.7\nFIELDS x y z {name}\nSIZE 4 4 4 4\nTYPE F F F {kind}\nCOUNT 1 1 1 1\n\
             WIDTH {points}\nHEIGHT 1\nPOINTS {points}\nDATA "
        );
        std::fs::write(&path, [head.as_bytes(), data].concat()).unwrap();
        let mut sink = ColourSink::default();
        read_points(&path, &mut sink).unwrap();
        sink.0
    }

    #[test]
    fn packed_colours_are_read_from_text_and_from_the_bits_of_floats() {
        // The first number is one of the documentation of the format: 0x4a8080e0 as bits of a float.
        let text = b"ascii\n1 2 3 4.2108e+06\n1 2 3 2.3463979e-38\n1 2 3 nan\n1 2 3 9.2557167e-41\n";
        let expected = [[128, 128, 224], [255, 128, 7], [0; 3], [1, 2, 3]].map(Some);
        assert_eq!(colours("rgb", 'F', 4, text), expected);
        let unsigned = b"ascii\n1 2 3 4278190335\n1 2 3 16744455\n";
        assert_eq!(colours("rgba", 'U', 2, unsigned), [[0, 0, 255], [255, 128, 7]].map(Some));
        assert_eq!(colours("rgb", 'I', 1, b"ascii\n1 2 3 -16776961\n"), [Some([0, 0, 255])]);
        // Opaque: the bits are those of a float that is NaN.
        let binary = |bits: u32| [b"binary\n", &[0; 12][..], &bits.to_le_bytes()].concat();
        for kind in ['F', 'U', 'I'] {
            assert_eq!(colours("rgb", kind, 1, &binary(0xffff_8007)), [Some([255, 128, 7])], "{kind}");
        }
        assert_eq!(colours("curvature", 'F', 1, &binary(7)), [None]);
    }

    #[test]
    fn columns_of_red_green_and_blue_are_read_from_text() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pcd");
        let text = "VERSION 0.7\nFIELDS x y z red green blue\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n\
                    1 2 3 255 128 7\n";
        std::fs::write(&path, text).unwrap();
        let mut sink = ColourSink::default();
        read_points(&path, &mut sink).unwrap();
        assert_eq!(sink.0, [Some([255, 128, 7])]);
    }

    #[test]
    fn lzf_repeats_what_it_refers_to() {
        // "abc", then 9 bytes from 3 before, then 300 from 1 before.
        let packed = [2, b'a', b'b', b'c', 0xe0, 0, 2, 0xe0, 255, 0, 0xe0, 27, 0];
        let expected = [b"abcabcabcabc".to_vec(), vec![b'c'; 264 + 36]].concat();
        assert_eq!(lzf(&packed, expected.len()), Some(expected.clone()));
        assert_eq!(lzf(&packed, expected.len() - 1), None);
        assert_eq!(lzf(&packed[..4], 3), Some(b"abc".to_vec()));
        for wrong in [&[5, b'a'][..], &[0x20, 0], &[0xe0]] {
            assert_eq!(lzf(wrong, 3), None, "{wrong:?}");
        }
    }
}
