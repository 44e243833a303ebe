//! Reports of problems for people: the message, the place, the quoted line with the underlined text, the
//! hint. [`Render`] adds them to [`Diagnostics`] and [`Diagnostic`].

#![deny(unsafe_code)]

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};
use vlscan_base::diag::{Diagnostic, Diagnostics, Severity};

/// Maximum number of lines of a report.
const MAX_REPORT_LINES: usize = 20;
/// Maximum number of lines of a report that are reserved for problems with a line each.
const MAX_RESERVED_LINES: usize = 10;

/// Problems as reports.
///
/// ```
/// use std::path::Path;
/// use vlscan_base::diag::{Diagnostics, Place};
/// use vlscan_render::Render as _;
///
/// let mut problems = Diagnostics::default();
/// let place = Place::in_text(Path::new("s.xml"), "<leg z='abc'/>", 8..11);
/// problems.error(Some(place), "expected a number of metres, found \"abc\"").help("write z=\"0\"");
/// let report = problems.render(false);
/// assert!(report.contains("--> s.xml:1:9") && report.contains("^^^"));
/// ```
pub trait Render {
    /// The report, which ends with a line break. Of several problems it has at most 20 lines, errors first:
    /// file, line, column and the underlined text of the first problems, one line for each of the following
    /// ones, and the number of those that have no line.
    fn render(&self, coloured: bool) -> String;

    /// [`Render::render`] of the warnings alone.
    fn render_warnings(&self, coloured: bool) -> String;
}

impl Render for Diagnostics {
    fn render(&self, coloured: bool) -> String {
        report(self, coloured, |_| true)
    }

    fn render_warnings(&self, coloured: bool) -> String {
        report(self, coloured, |severity| severity == Severity::Warning)
    }
}

impl Render for Diagnostic {
    fn render(&self, coloured: bool) -> String {
        let level = match self.severity {
            Severity::Error => Level::ERROR,
            Severity::Warning => Level::WARNING,
            Severity::Note => Level::NOTE,
        };
        let title = level.primary_title(self.message.as_str());
        let path = self.place.as_ref().map(|p| p.path.display().to_string());
        let mut group = match (&self.place, path) {
            (Some(place), Some(path)) if place.line == 0 => title.element(Origin::path(path)),
            (Some(place), Some(path)) => {
                let annotation = AnnotationKind::Primary.span(place.marked.clone());
                let snippet =
                    Snippet::source(place.excerpt.as_str()).line_start(place.line).annotation(annotation);
                // The renderer counts columns within the excerpt, which is wrong for a cut excerpt.
                if place.excerpt[..place.marked.start].chars().count() + 1 == place.column {
                    title.element(snippet.path(path))
                } else {
                    let origin = Origin::path(path).line(place.line).char_column(place.column);
                    title.element(origin).element(snippet)
                }
            }
            _ => Group::with_title(title),
        };
        if let Some(help) = &self.help {
            group = group.element(Level::HELP.message(help.as_str()));
        }
        if let Some(repeated) = self.repeated() {
            group = group.element(Level::NOTE.message(repeated));
        }
        let renderer = if coloured { Renderer::styled() } else { Renderer::plain() };
        let mut text = renderer.render(&[group]).to_string();
        text.push('\n');
        text
    }

    fn render_warnings(&self, coloured: bool) -> String {
        if self.severity == Severity::Warning { self.render(coloured) } else { String::new() }
    }
}

fn report(problems: &Diagnostics, coloured: bool, is_shown: impl Fn(Severity) -> bool) -> String {
    let mut shown: Vec<&Diagnostic> = problems.items().iter().filter(|d| is_shown(d.severity)).collect();
    shown.sort_by_key(|d| d.severity);
    let (mut text, mut lines) = (String::new(), 0);
    for (i, problem) in shown.iter().enumerate() {
        let left = shown.len() - i - 1;
        let blank = if i > 0 { "\n" } else { "" };
        let complete = format!("{blank}{}", problem.render(coloured));
        let needed = complete.lines().count() + left.min(MAX_RESERVED_LINES);
        let added = if i == 0 || lines + needed <= MAX_REPORT_LINES { complete } else { problem.line() };
        if lines + 1 == MAX_REPORT_LINES && left > 0 {
            text.push_str(&format!("... and {} more problems\n", left + 1));
            break;
        }
        lines += added.lines().count();
        text.push_str(&added);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use vlscan_base::diag::Place;

    #[test]
    fn a_report_shows_file_line_and_caret() {
        let mut d = Diagnostics::default();
        let place = Place::in_text(Path::new("s.xml"), "<leg z='abc'/>", 8..11);
        d.error(Some(place), "expected a number of metres, found \"abc\"").help("write z=\"0\"");
        let report = d.render(false);
        for part in ["error: expected a number of metres", "s.xml:1:9", "^^^", "help: write z=\"0\""] {
            assert!(report.contains(part), "{part:?} is missing from\n{report}");
        }
    }

    #[test]
    fn reports_have_at_most_twenty_lines_and_name_errors_first() {
        let mut d = Diagnostics::default();
        let text = "<a f='1'/>\n".repeat(50);
        for i in 0..50 {
            let place = Place::in_text(Path::new("s.xml"), &text, i * 11 + 3..i * 11 + 4);
            d.warn(Some(place), format!("unknown attribute `f{i}`")).help("leave it out");
        }
        d.error(None, "the last problem is an error");
        let report = d.render(false);
        assert_eq!(report.lines().count(), MAX_REPORT_LINES, "{report}");
        assert!(report.starts_with("error: the last problem is an error"), "{report}");
        assert!(report.contains("`f0`") && report.contains("help: leave it out"), "{report}");
        assert!(report.contains("\nwarning: s.xml:4:4: unknown attribute `f3`; leave it out\n"), "{report}");
        let listed = report.matches("unknown attribute").count();
        assert!(report.ends_with(&format!("... and {} more problems\n", 50 - listed)), "{report}");
        assert!(!d.render_warnings(false).contains("error"));
    }

    #[test]
    fn repeated_problems_name_their_lines() {
        let text = "<a f='1'/>\n<a f='1'/>\n<a f='1'/>";
        let mut d = Diagnostics::default();
        for at in [3, 14, 25] {
            d.warn(Some(Place::in_text(Path::new("s.xml"), text, at..at + 1)), "unknown attribute `f`");
        }
        assert!(d.render(false).contains("also in line 2, 3"), "{}", d.render(false));
    }

    #[test]
    fn reports_of_long_lines_keep_the_column() {
        let text = format!("{}X{}", "é".repeat(5000), "b".repeat(5000));
        let mut d = Diagnostics::default();
        d.error(Some(Place::in_text(Path::new("s.xml"), &text, 10_000..10_001)), "wrong");
        assert!(d.render(false).contains("s.xml:1:5001"), "{}", d.render(false));
    }

    #[test]
    fn reports_have_no_control_characters() {
        let mut d = Diagnostics::default();
        d.error(None, "material \"\u{1b}[31m\nred\"");
        assert!(!d.render(false).contains('\u{1b}'));
    }
}
