//! Textures of material files: `map_Kd` with its options.

use super::number::float;
use super::text::operand;
use std::ops::Range;
use std::path::Path;
use vlscan_base::columns::decoded;
use vlscan_survey::{ColourDefinition, MaterialDefinition, TextureDefinition, TextureImage, TextureWrap};

/// A word of a line, and its bytes there.
type Word<'l> = (&'l [u8], Range<usize>);

/// The colour of a material, white until a line states another one.
pub(super) fn colour_of(material: &mut MaterialDefinition) -> &mut ColourDefinition {
    material.colour.get_or_insert_with(|| ColourDefinition::stored([1.0; 3]))
}

/// Gives a material the texture of a line, whose values begin at `first`. The name of the file follows the
/// options and may have blanks. A line without a name changes nothing.
pub(super) fn set(
    material: &mut MaterialDefinition,
    folder: &Path,
    line: &[u8],
    (first, values): (usize, &[Word]),
) {
    let mut transform = TextureDefinition::IDENTITY;
    let mut wrap = [TextureWrap::Repeat; 2];
    let (mut at, mut start) = (0, first);
    while let Some((word, _)) = values.get(at).filter(|(word, _)| word.starts_with(b"-")) {
        let arguments = &values[at + 1..];
        let numbers: Vec<f64> =
            arguments.iter().take(3).map_while(|(word, _)| float(word).filter(|n| n.is_finite())).collect();
        let pair = |default: f64| [0, 1].map(|i| numbers.get(i).copied().unwrap_or(default));
        let count = match *word {
            b"-s" => {
                let [u, v] = pair(1.0);
                transform.0 = [[u, 0.0], [0.0, v]];
                numbers.len()
            }
            b"-o" => {
                transform.1 = pair(0.0);
                numbers.len()
            }
            b"-t" => numbers.len(),
            b"-mm" => 2,
            b"-clamp" => {
                let is_on = arguments.first().is_some_and(|(word, _)| word.eq_ignore_ascii_case(b"on"));
                wrap = [if is_on { TextureWrap::Clamp } else { TextureWrap::Repeat }; 2];
                1
            }
            b"-blendu" | b"-blendv" | b"-cc" | b"-boost" | b"-bm" | b"-texres" | b"-imfchan" | b"-type" => 1,
            _ => break,
        };
        at += 1 + count;
        start = values.get(at - 1).map_or(line.len(), |(_, place)| place.end);
    }
    let name = decoded(&line[operand(line, start.min(line.len()))]);
    if name.is_empty() {
        return;
    }
    let image = TextureImage::File(folder.to_path_buf(), name);
    colour_of(material).texture = Some(TextureDefinition { image, transform, wrap, is_upward: true });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mtl;
    use crate::text::Source;
    use vlscan_base::diag::Diagnostics;

    fn colours(text: &str) -> Vec<Option<ColourDefinition>> {
        let mut problems = Diagnostics::default();
        let found = mtl::read(&Source::of("a/m.mtl", text.as_bytes()), &mut problems);
        assert!(problems.is_empty(), "{}", problems.text());
        found.into_iter().map(|material| material.colour).collect()
    }

    #[test]
    fn lines_give_colours_and_textures() {
        let found = colours(
            "newmtl a\nKd 0.5 0.25 2\nmap_Kd -s 2 3 1 -o 0.5 -clamp on -bm 1 wall (old).png # c\nnewmtl b\n\
             map_Kd ..\\t.jpg\nnewmtl c\nKs 1 1 1\nnewmtl d\nmap_Kd\n",
        );
        let a = found[0].as_ref().unwrap();
        assert_eq!((a.factor, a.is_linear), ([0.5, 0.25, 1.0], false));
        let texture = a.texture.as_ref().unwrap();
        assert_eq!(texture.image, TextureImage::File("a".into(), "wall (old).png".to_owned()));
        assert_eq!(texture.transform, ([[2.0, 0.0], [0.0, 3.0]], [0.5, 0.0]));
        assert_eq!((texture.wrap, texture.is_upward), ([TextureWrap::Clamp; 2], true));
        let b = found[1].as_ref().unwrap();
        assert_eq!(b.factor, [1.0; 3]);
        assert_eq!(b.texture.as_ref().unwrap().image, TextureImage::File("a".into(), "..\\t.jpg".to_owned()));
        assert_eq!(found[2..], [None, None]);
    }
}
