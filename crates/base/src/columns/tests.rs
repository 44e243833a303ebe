//! Tests of columns.

use super::*;

fn texts(separator: Separator, line: &str) -> Vec<&str> {
    separator.split(line).map(|at| &line[at]).collect()
}

#[test]
fn separators_are_guessed_and_split_without_blanks() {
    assert_eq!(texts(Separator::guess("1, 2,3"), "1, 2,3"), ["1", "2", "3"]);
    assert_eq!(texts(Separator::guess("1;2 ;3;"), "1;2 ;3;"), ["1", "2", "3"]);
    assert_eq!(texts(Separator::guess("  1\t2\t"), "  1\t2\t"), ["1", "2"]);
    assert_eq!(texts(Separator::guess(" 1  2\r"), " 1  2\r"), ["1", "2"]);
    assert_eq!(texts(Separator::Char(','), "1,,3"), ["1", "", "3"]);
}

#[test]
fn lines_are_split_into_words_as_one_after_the_other() {
    let mut stream = 7u64;
    let mut next = |count: u64| {
        stream = stream.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (stream >> 33) % count
    };
    let letters =
        [" ", " ", "\t", ",", ",", ";", "1", "2.5", "\"", "é", "\r", "\x0b", "-431000.25", "\x01", "\x7f"];
    for i in 0..30_000 {
        let length = next(if i % 2 == 0 { 12 } else { 40 });
        let line: String = (0..length).map(|_| letters[next(letters.len() as u64) as usize]).collect();
        let all = [Separator::Blanks, Separator::any_of(",;")];
        let chars = [',', ';', '\t', 'é', '\r'].map(Separator::Char);
        for separator in all.into_iter().chain(chars) {
            let mut words: Vec<_> = separator.split("0").collect();
            separator.split_into(line.as_bytes(), &mut words);
            let expected: Vec<_> = separator.split("0").chain(separator.split(&line)).collect();
            assert_eq!(words, expected, "{separator:?} {line:?}");
        }
    }
}

#[test]
fn plain_numbers_are_those_that_are_parsed() {
    let mut stream = 3u64;
    let mut next = |count: u64| {
        stream = stream.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (stream >> 33) % count
    };
    let mut plain = 0;
    for _ in 0..200_000 {
        let length = next(18);
        let text: String = (0..length)
            .map(|i| match next(if i == 0 { 13 } else { 12 }) {
                10 | 11 => '.',
                12 => '-',
                digit => char::from(b'0' + digit as u8),
            })
            .collect();
        if let Some(number) = plain_number(text.as_bytes()) {
            assert_eq!(text.parse::<f64>().map(f64::to_bits), Ok(number.to_bits()), "{text:?}");
            plain += 1;
        }
    }
    assert!(plain > 50_000, "{plain}");
    for text in ["", "-", ".", "-.", "1e5", "+1", "inf", "nan", "1 ", "1234567890123456", "--1", "1.2.3"] {
        assert_eq!(plain_number(text.as_bytes()), None, "{text:?}");
    }
    let negative = plain_number(b"-0.0").map(f64::to_bits);
    assert_eq!(negative, Some((-0.0f64).to_bits()));
}

#[test]
fn commas_between_columns_and_within_numbers_are_told_apart() {
    for (line, expected) in [
        ("1,5\t2,5\t3,5", "\t"),
        ("-1,5 2 3,5e3 oak", " "),
        ("1,2,3", ","),
        ("1, 2, 3", ","),
        ("1 ,2 ,3", ","),
        ("1,5 2,5", ","),
        ("7,1.5,2 3", ","),
        ("7,oak tree,1,2,3", ","),
        ("1,5;2,5;3,5", ";"),
    ] {
        assert_eq!(Separator::guess(line).characters(), expected, "{line:?}");
    }
}

#[test]
fn several_characters_may_separate() {
    assert_eq!(texts(Separator::any_of(" ,"), "1, 2\t,3"), ["1", "", "2", "3"]);
    assert_eq!(texts(Separator::any_of("·"), "1 · 2·3"), ["1", "2", "3"]);
    assert_eq!(texts(Separator::any_of("\t"), "1\t 2 3\t\t4"), ["1", "2 3", "", "4"]);
    for blanks in ["", " ", " \t"] {
        assert_eq!(Separator::any_of(blanks), Separator::Blanks);
    }
}

#[test]
fn spreadsheets_state_their_separator() {
    let stated =
        ["sep=;", "\u{feff}SEP=,\r", "sep=\t", "sep=", "sep=ab", "separator", "é"].map(stated_separator);
    assert_eq!(stated, [Some(';'), Some(','), Some('\t'), None, None, None, None]);
}

#[test]
fn decimal_commas_are_recognised() {
    for (text, is_one) in [
        ("345600,0", true),
        ("-1,5", true),
        ("1,2,3", false),
        ("1.5", false),
        ("1,5e-3", true),
        ("a,5", false),
        ("5,", false),
        (",5", false),
    ] {
        assert_eq!(has_decimal_comma(text), is_one, "{text}");
    }
}

#[test]
fn columns_may_be_quoted() {
    let split = |line: &'static str| texts(Separator::guess(line), line);
    assert_eq!(split(r#""x","y", "z" ,"""#), ["x", "y", "z", ""]);
    assert_eq!(split(r#""1,5";"a;b";3"#), ["1,5", "a;b", "3"]);
    assert_eq!(split(r#" "Norway spruce"  "2" 3"#), ["Norway spruce", "2", "3"]);
    assert_eq!(split(r#""a ""b""",2"#), [r#"a ""b"""#, "2"]);
    // Quotes that do not enclose a column belong to it.
    assert_eq!(split(r#"5" oak,"a"b,"c"#), [r#"5" oak"#, r#""a"b"#, r#""c"#]);
    assert_eq!([split("\""), split("1,\""), split("\"\"\"")], [vec!["\""], vec!["1", "\""], vec!["\"\"\""]]);
}

#[test]
fn commas_that_do_not_separate_are_decimal_commas() {
    let number = |separator: Separator, field: &str, others: &str| {
        separator.number(field.as_bytes(), others.split(' ').map(str::as_bytes))
    };
    for (separator, others, expected) in [
        (Separator::Char(';'), "1,5 2 a.obj", Some(1.5)),
        (Separator::Char('\t'), "1,5", Some(1.5)),
        (Separator::Blanks, "1,5 2,5", Some(1.5)),
        (Separator::Char(';'), "1,5 2.5", None),
        (Separator::Char(','), "1,5", None),
        (Separator::any_of(",;"), "1,5", None),
    ] {
        assert_eq!(number(separator, "1,5", others), expected, "{separator:?} {others}");
        assert_eq!(number(separator, " 1.5", others), Some(1.5));
    }
    assert_eq!(number(Separator::Char(';'), "1,475,5", ""), None);
    assert_eq!(["1.5", "1,5", "1,5 ", "x", ""].map(is_number), [true, true, true, false, false]);
}

#[test]
fn quotes_keep_separators() {
    let fields = |line: &str| unquoted(line, Separator::guess(line));
    assert_eq!(fields(r#"a, "b, ""c""" ,d e,"#), ["a", r#"b, "c""#, "d e", ""]);
    assert_eq!(fields(r#"5" oak;" x";;"#), [r#"5" oak"#, " x", "", ""]);
    assert_eq!(fields(r#" 1  "Norway spruce" 3 "#), ["1", "Norway spruce", "3"]);
    assert_eq!(fields(r#"a,"b"#), ["a", "b"]);
    for text in ["oak", "a \"b\", c", "two\nlines", ""] {
        let line = format!("{},1", quoted(text));
        assert_eq!(unquoted(&line, Separator::Char(','))[0], text);
    }
    assert_eq!((quoted("a \"b\", c"), quoted("oak")), ("\"a \"\"b\"\", c\"".to_owned(), "oak".to_owned()));
}
