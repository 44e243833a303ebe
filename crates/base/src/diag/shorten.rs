//! Messages of limited length.

/// Maximum length and number of lines of a message or hint; longer ones, which quote long values, are cut.
pub(super) const MAX_MESSAGE_BYTES: usize = 600;
pub(super) const MAX_MESSAGE_LINES: usize = 6;
/// Maximum length of a word, bytes: longer ones are cut where a message is.
const MAX_WORD_BYTES: usize = 60;

/// `text` with at most [`MAX_MESSAGE_BYTES`] bytes and [`MAX_MESSAGE_LINES`] lines: what is between its
/// beginning and its end is replaced by an ellipsis.
pub(super) fn shortened(text: String) -> String {
    let head = text.match_indices('\n').nth(MAX_MESSAGE_LINES - 1).map_or(text.len(), |(end, _)| end);
    if head == text.len() && text.len() <= MAX_MESSAGE_BYTES {
        return text;
    }
    let head = text.floor_char_boundary(head.min(MAX_MESSAGE_BYTES * 2 / 3));
    let tail = text.ceil_char_boundary(text.len().saturating_sub(MAX_MESSAGE_BYTES / 3).max(head));
    let tail = text[tail..].rfind('\n').map_or(tail, |end| tail + end + 1);
    let (mut before, mut after) = (&text[..head], &text[tail..]);
    // Words are kept whole or left out; anything longer than a word, a quoted value, is cut.
    let is_blank = char::is_whitespace;
    if !text[head..].starts_with(is_blank) {
        let end = before.rfind(is_blank).filter(|end| head - end <= MAX_WORD_BYTES);
        before = &before[..end.unwrap_or(head)];
    }
    if !text[..tail].ends_with(is_blank) {
        let start = after.find(is_blank).filter(|start| *start <= MAX_WORD_BYTES);
        after = &after[start.unwrap_or(0)..];
    }
    format!("{} … {}", before.trim_end(), after.trim_start())
}

/// Names in one line; of many, the first `max` and the number of the others.
pub fn listed<T: AsRef<str>>(names: &[T], max: usize) -> String {
    let shown: Vec<&str> = names.iter().take(max).map(AsRef::as_ref).collect();
    match names.len().saturating_sub(max) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_cut_between_words() {
        let names: Vec<String> = (0..100).map(|i| format!("received_energy_min_{i}_w")).collect();
        let cut = shortened(format!("the keys here are {}", names.join(", ")));
        let words: Vec<&str> = cut.split(' ').skip(4).map(|word| word.trim_end_matches(',')).collect();
        assert!(words.len() > 15 && words.contains(&"…"), "{cut}");
        assert!(words.iter().all(|word| *word == "…" || names.iter().any(|name| name == word)), "{cut}");
    }
}
