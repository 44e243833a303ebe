//! Tests of lines of text.

use super::*;

#[test]
fn continued_lines_are_one_line_whose_offsets_are_those_of_the_file() {
    let text = b"a\nf 1 2 \\\r\n 3\\\n4\nend";
    let lines: Vec<_> = Lines::new(text, true).map(|l| (l.number, l.start, l.text.into_owned())).collect();
    assert_eq!(lines.len(), 3);
    assert_eq!(lines[1].0, 2);
    let at = lines[1].2.iter().position(|&b| b == b'4').unwrap();
    assert_eq!(text[lines[1].1 + at], b'4');
    assert_eq!((lines[2].0, &lines[2].2[..]), (5, &b"end"[..]));
}

#[test]
fn an_operand_is_the_rest_of_the_line_without_a_comment() {
    for (line, expected) in [
        ("usemtl red  brick\r", "red  brick"),
        ("usemtl\tMaterial #25", "Material #25"),
        ("usemtl oak # the old one", "oak"),
        ("usemtl oak #", "oak"),
        ("usemtl # none", ""),
        ("usemtl", ""),
        ("usemtl C#", "C#"),
    ] {
        assert_eq!(&line[operand(line.as_bytes(), 6)], expected, "{line}");
    }
}

#[test]
fn a_continuation_at_the_end_of_the_file_ends_with_it() {
    for text in [&b"f 1 2 \\"[..], b"\\", b"\\\r", b"\\\n\\\n\\"] {
        assert_eq!(Lines::new(text, true).count(), 1, "{text:?}");
    }
}

#[test]
fn pieces_end_with_complete_lines() {
    let text = b"v 1 2 3\nf 1 2 \\\n3 4\\\r\n5\nend without line break";
    for length in 1..text.len() + 2 {
        let pieces = cut_into_pieces(text, length);
        let joined: Vec<u8> = pieces.iter().flat_map(|p| text[p.clone()].to_vec()).collect();
        assert_eq!(joined, text);
        let lines: usize = pieces.iter().map(|p| Lines::new(&text[p.clone()], true).count()).sum();
        assert_eq!(lines, 3, "pieces of {length}");
    }
}

#[test]
fn carriage_returns_alone_become_line_feeds() {
    let fed = |text: &str| Source::of("a", text.as_bytes()).with_line_feeds().map(|s| s.bytes().to_vec());
    assert_eq!(fed("\u{feff}1 2\r3 4\r\n5\r"), Some(b"1 2\n3 4\r\n5\n".to_vec()));
    assert_eq!((fed("1 2\r\n3\n"), fed("")), (None, None));
}

#[test]
fn lines_have_a_greatest_length() {
    let refused = |text: Vec<u8>| {
        let mut d = Diagnostics::default();
        let is_text = Source::of("l.obj", &text).is_text(&Expected::MESH.named("vertices"), &mut d);
        assert_eq!(is_text, d.is_empty());
        d.items().first().map(|d| (d.place.as_ref().map_or(0, |p| p.line), d.message.clone()))
    };
    let longest = [vec![b'x'; MAX_LINE_BYTES], b"\n".to_vec()].concat();
    assert_eq!(refused(longest.repeat(3)), None);
    let (line, message) = refused([&longest[..], b"v 1 2 3\ny", &longest].concat()).unwrap();
    assert_eq!((line, message.as_str()), (3, "a line of more than 1048576 bytes, expected vertices"));
}

#[test]
fn a_place_in_noise_can_be_shown() {
    let source = Source::of("n.obj", b"ok\n\xff\xfe\x1b[31m bad \x00\r\nok");
    let place = source.place(2, 3..5);
    assert_eq!(place.line, 2);
    assert_eq!(&place.excerpt[place.marked.clone()], "\u{fffd}\u{fffd}");
    assert!(!place.excerpt.contains('\x1b'));
    let long = Source::of("l.obj", &[b'x'; 5000]);
    assert!(long.place(1, 4000..4003).excerpt.len() <= MAX_SHOWN_BYTES);
}
