//! Bytes to fixes: which of the layouts they have, and what they say.

use super::binary::{Records, looks_like_sbet};
use super::fix::{Fix, Mark, Problem};
use super::text::Lines;
use crate::survey::{PoseFormat, PoseStream};

/// What the next bytes of a trajectory are.
#[derive(Debug)]
pub enum Next<'t> {
    /// More of them must arrive first.
    More,
    /// So many bytes hold no fix.
    Passed(usize),
    /// A fix, and how many bytes it takes.
    Fix(usize, Fix, Mark<'t>),
    /// What cannot be read.
    Wrong(Mark<'t>, Problem),
}

/// Reads one of the layouts.
#[derive(Debug)]
pub enum Source {
    /// It has not yet been found out which.
    Unknown(Box<PoseStream>),
    Text(Box<Lines>),
    Binary(Records),
}

/// Bytes that begin every TerraScan trajectory.
const TERRASCAN: &[u8] = b"TSCANTRJ";
/// Fewer bytes hold no pose in any layout.
const SHORTEST: usize = 14;
/// With so many bytes at hand even a guess is sure.
const ENOUGH: usize = 136;

impl Source {
    pub fn new(settings: &PoseStream) -> Source {
        match settings.format {
            None => Source::Unknown(Box::new(settings.clone())),
            Some(PoseFormat::Text | PoseFormat::Helios) => {
                Source::Text(Box::new(Lines::new(settings.clone())))
            }
            Some(PoseFormat::Sbet) => Source::Binary(Records::sbet()),
            Some(PoseFormat::TerraScan) => Source::Binary(Records::terrascan()),
        }
    }

    /// What `bytes`, the next ones, are; `ended` when no others will follow.
    pub fn next<'t>(&mut self, bytes: &'t [u8], ended: bool) -> Next<'t> {
        if let Source::Unknown(settings) = self {
            match recognised(bytes, ended) {
                Recognised::No => return Next::More,
                Recognised::Text => *self = Source::Text(Box::new(Lines::new((**settings).clone()))),
                Recognised::Sbet => *self = Source::Binary(Records::sbet()),
                Recognised::TerraScan => *self = Source::Binary(Records::terrascan()),
                Recognised::Nothing(help) => {
                    let message = "this is neither text nor SBET nor a TerraScan trajectory";
                    let mark = Mark::Record { number: 1, byte: 0 };
                    return Next::Wrong(mark, Problem::new(message).help(help));
                }
            }
        }
        match self {
            Source::Unknown(_) => Next::More,
            Source::Text(lines) => lines.next(bytes, ended),
            Source::Binary(records) => records.next(bytes, ended),
        }
    }

    /// A word for messages.
    pub fn name(&self) -> &'static str {
        match self {
            Source::Unknown(_) => "nothing",
            Source::Text(lines) => lines.name(),
            Source::Binary(records) => records.name(),
        }
    }
}

#[derive(Debug, PartialEq)]
enum Recognised {
    /// More bytes are needed.
    No,
    Text,
    Sbet,
    TerraScan,
    /// None of them, with what can be done.
    Nothing(&'static str),
}

/// Text has no control characters, TerraScan begins with its name, and the first record of an SBET makes sense.
fn recognised(bytes: &[u8], ended: bool) -> Recognised {
    if bytes.is_empty() || bytes.len() < SHORTEST && !ended {
        return Recognised::No;
    }
    if bytes.starts_with(TERRASCAN) {
        return Recognised::TerraScan;
    }
    let start = &bytes[..bytes.len().min(ENOUGH)];
    let is_text = !start.iter().any(|b| b.is_ascii_control() && !b.is_ascii_whitespace());
    // Few bytes could be text by chance, unless they are plain.
    if is_text && (ended || start.len() == ENOUGH || start.iter().all(u8::is_ascii)) {
        return Recognised::Text;
    }
    if start.len() < ENOUGH && !ended {
        return Recognised::No;
    }
    if looks_like_sbet(start) {
        return Recognised::Sbet;
    }
    Recognised::Nothing(if start.starts_with(&[0xff, 0xfe]) || start.starts_with(&[0xfe, 0xff]) {
        "convert UTF-16 first: iconv -f UTF-16 -t UTF-8"
    } else {
        "say what it is with --trajectory-format"
    })
}

#[cfg(test)]
mod tests {
    use super::super::binary::testing;
    use super::*;

    #[test]
    fn layouts_are_recognised_by_their_first_bytes() {
        let sbet = testing::sbet(&[[1000.0, 0.8, 0.1, 300.0, 0.0, 0.0, 0.0]]);
        let trj = testing::terrascan(&[[1.0; 7]]);
        assert_eq!(recognised(&sbet, false), Recognised::Sbet);
        assert_eq!(recognised(&sbet[..100], false), Recognised::No);
        assert_eq!(recognised(&trj, false), Recognised::TerraScan);
        for text in [
            "1 2 3 4 5 6 7\n",
            "\u{feff}time,x,y,z,roll,pitch,yaw\n",
            "# Höhe über Grund in Metern, sonst nichts\n",
        ] {
            assert_eq!(recognised(text.as_bytes(), true), Recognised::Text, "{text}");
        }
        assert_eq!(recognised(b"1 2 3 4 5 6 7\n", false), Recognised::Text);
        assert_eq!(recognised(b"1 2 3", false), Recognised::No);
        assert_eq!(recognised(b"", true), Recognised::No);
        assert!(matches!(recognised(&[0; 136], false), Recognised::Nothing(_)));
        assert!(
            matches!(recognised(b"\xff\xfet\0i\0m\0e\0,\0x\0", true), Recognised::Nothing(h) if h.contains("iconv"))
        );
    }
}
