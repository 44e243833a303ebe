//! Formulas in scanner and survey files.

use std::f64::consts::{E, PI};
use std::ops::Range;
use vlscan_base::error::Error;
use vlscan_base::quantity;

/// A parsed formula of one variable (spec input-formats §1.6).
///
/// The variable is `t` or `THETA`, the constants are `pi` and `e`, the operators `+ - * / ^` (all
/// left-associative, `^` has the highest precedence). Brackets may be nested; the functions are
/// `exp ln sqrt abs cos sin tan acos asin atan cosh sinh tanh` of one and `atan2` of two arguments. Angles
/// are radians. Numbers may have an exponent, every operand may have a minus sign (`-t^2` is `-(t^2)`), and
/// `x^0` is 1.
///
/// ```
/// use vlscan_survey::Formula;
/// let error = Formula::parse("0.002 + 1e-5*t^2").unwrap();
/// assert_eq!(error.eval(100.0), 0.002 + 1e-5 * 1e4);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    /// The formula as written.
    text: String,
    /// The formula in postfix order; evaluation needs at most [`MAX_STACK`] stack entries.
    steps: Vec<Step>,
}

/// The error of an invalid formula, with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FormulaError {
    /// Range of the invalid bytes in the text.
    pub at: Range<usize>,
    /// Found and expected text.
    pub message: String,
}

/// Maximum number of entries of the evaluation stack.
const MAX_STACK: usize = 64;
/// Maximum nesting of brackets and functions.
const MAX_DEPTH: usize = 50;
/// Maximum literal exponent that is evaluated by repeated multiplication.
const MAX_REPEATED: f64 = 1024.0;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Push(f64),
    Variable,
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    /// Repeated multiplication, which the reference uses for integer exponents.
    WholePower(u32),
    /// A function by its index in [`FUNCTIONS`].
    Call(usize),
    Atan2,
}

type Function = fn(f64) -> f64;

const FUNCTIONS: [(&str, Function); 13] = [
    ("exp", libm::exp),
    ("ln", libm::log),
    ("sqrt", f64::sqrt),
    ("abs", f64::abs),
    ("cos", libm::cos),
    ("sin", libm::sin),
    ("tan", libm::tan),
    ("acos", libm::acos),
    ("asin", libm::asin),
    ("atan", libm::atan),
    ("cosh", libm::cosh),
    ("sinh", libm::sinh),
    ("tanh", libm::tanh),
];

impl Formula {
    /// Parses `text`; the error marks the first invalid place.
    pub fn parse(text: &str) -> Result<Formula, FormulaError> {
        let mut parser =
            Parser { text, at: 0, token: Token::End, span: 0..0, steps: Vec::new(), height: 0, depth: 0 };
        parser.advance()?;
        parser.sum()?;
        match parser.token {
            Token::End => Ok(Formula { text: text.to_owned(), steps: parser.steps }),
            _ => Err(parser.unexpected("an operator or the end of the formula")),
        }
    }

    /// The value at `t`, which must be within the bounds of all numbers.
    ///
    /// # Errors
    /// [`Error::Input`] that names the formula of `what`, the value and the argument.
    pub fn number(&self, what: &str, t: f64) -> Result<f64, Error> {
        let value = self.eval(t);
        if quantity::NUMBER.contains(value) {
            return Ok(value);
        }
        let expected = quantity::NUMBER.expected;
        let (value, t) = (quantity::number(value), quantity::number(t));
        let message =
            format!("the formula of the {what}, `{}`, is {value} at {t}, expected {expected}", self.text);
        Err(Error::input(message))
    }

    /// The value at `t`. Arguments outside a function's domain yield NaN or infinity.
    pub fn eval(&self, t: f64) -> f64 {
        let mut stack = [0.0; MAX_STACK];
        let mut top = 0;
        for step in &self.steps {
            match *step {
                Step::Push(value) => {
                    stack[top] = value;
                    top += 1;
                }
                Step::Variable => {
                    stack[top] = t;
                    top += 1;
                }
                Step::Negate => stack[top - 1] = -stack[top - 1],
                Step::WholePower(n) => stack[top - 1] = whole_power(stack[top - 1], n),
                Step::Call(function) => stack[top - 1] = FUNCTIONS[function].1(stack[top - 1]),
                Step::Add | Step::Subtract | Step::Multiply | Step::Divide | Step::Power | Step::Atan2 => {
                    top -= 1;
                    let (a, b) = (stack[top - 1], stack[top]);
                    stack[top - 1] = match step {
                        Step::Add => a + b,
                        Step::Subtract => a - b,
                        Step::Multiply => a * b,
                        Step::Divide => a / b,
                        Step::Power => libm::pow(a, b),
                        _ => libm::atan2(a, b),
                    };
                }
            }
        }
        stack[0]
    }
}

fn whole_power(base: f64, n: u32) -> f64 {
    (1..n).fold(if n == 0 { 1.0 } else { base }, |product, _| product * base)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'a> {
    Number(f64),
    Name(&'a str),
    Symbol(char),
    End,
}

struct Parser<'a> {
    text: &'a str,
    /// Offset of the end of the current token, bytes.
    at: usize,
    token: Token<'a>,
    span: Range<usize>,
    steps: Vec<Step>,
    /// Height of the evaluation stack after the steps so far.
    height: usize,
    depth: usize,
}

impl<'a> Parser<'a> {
    fn sum(&mut self) -> Result<(), FormulaError> {
        self.chain([('+', Step::Add), ('-', Step::Subtract)], Parser::product)
    }

    fn product(&mut self) -> Result<(), FormulaError> {
        self.chain([('*', Step::Multiply), ('/', Step::Divide)], Parser::signed_power)
    }

    /// Operands joined by left-associative operators.
    fn chain(
        &mut self,
        operators: [(char, Step); 2],
        operand: fn(&mut Self) -> Result<(), FormulaError>,
    ) -> Result<(), FormulaError> {
        operand(self)?;
        while let Some((_, step)) = operators.iter().find(|(symbol, _)| self.token == Token::Symbol(*symbol))
        {
            self.advance()?;
            operand(self)?;
            self.emit(*step)?;
        }
        Ok(())
    }

    fn signed_power(&mut self) -> Result<(), FormulaError> {
        let negative = self.signs()?;
        self.operand()?;
        while self.token == Token::Symbol('^') {
            self.advance()?;
            self.exponent()?;
        }
        if negative { self.emit(Step::Negate) } else { Ok(()) }
    }

    fn exponent(&mut self) -> Result<(), FormulaError> {
        let negative = self.signs()?;
        match self.token {
            Token::Number(n) if !negative && n.fract() == 0.0 && n <= MAX_REPEATED => {
                self.advance()?;
                self.emit(Step::WholePower(n as u32))
            }
            _ => {
                self.operand()?;
                if negative {
                    self.emit(Step::Negate)?;
                }
                self.emit(Step::Power)
            }
        }
    }

    /// Skips signs and returns whether they negate the operand.
    fn signs(&mut self) -> Result<bool, FormulaError> {
        let mut negative = false;
        while let Token::Symbol(sign @ ('+' | '-')) = self.token {
            negative ^= sign == '-';
            self.advance()?;
        }
        Ok(negative)
    }

    fn operand(&mut self) -> Result<(), FormulaError> {
        match self.token {
            Token::Number(value) => {
                self.advance()?;
                self.emit(Step::Push(value))
            }
            Token::Symbol('(') => self.brackets(1),
            Token::Name(name) => self.named(name),
            _ => Err(self.unexpected("a number, t, THETA, a function or a bracket")),
        }
    }

    fn named(&mut self, name: &'a str) -> Result<(), FormulaError> {
        let (span, constant) = (
            self.span.clone(),
            match name {
                "t" | "THETA" => Some(Step::Variable),
                "pi" => Some(Step::Push(PI)),
                "e" => Some(Step::Push(E)),
                _ => None,
            },
        );
        if let Some(step) = constant {
            self.advance()?;
            return self.emit(step);
        }
        let function = FUNCTIONS.iter().position(|f| f.0 == name);
        if function.is_none() && name != "atan2" {
            let known = FUNCTIONS.iter().map(|f| f.0).chain(["atan2", "pi", "THETA"]);
            let meant = vlscan_base::diag::nearest(name, known);
            let hint = meant.map_or(String::new(), |m| format!(", did you mean `{m}`?"));
            return Err(FormulaError {
                at: span,
                message: format!("unknown name `{name}` in a formula{hint}"),
            });
        }
        self.advance()?;
        if self.token != Token::Symbol('(') {
            return Err(self.unexpected(&format!("`(` after `{name}`")));
        }
        match function {
            Some(function) => {
                self.brackets(1)?;
                self.emit(Step::Call(function))
            }
            None => {
                self.brackets(2)?;
                self.emit(Step::Atan2)
            }
        }
    }

    /// Parses an opening bracket, `count` sums separated by commas, and the closing bracket.
    fn brackets(&mut self, count: usize) -> Result<(), FormulaError> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(self.wrong("the formula is nested too deeply"));
        }
        for i in 0..count {
            self.advance()?;
            self.sum()?;
            let separator = if i + 1 < count { ',' } else { ')' };
            if self.token != Token::Symbol(separator) {
                return Err(self.unexpected(&format!("`{separator}`")));
            }
        }
        self.depth -= 1;
        self.advance()
    }

    fn emit(&mut self, step: Step) -> Result<(), FormulaError> {
        match step {
            Step::Push(_) | Step::Variable => self.height += 1,
            Step::Negate | Step::WholePower(_) | Step::Call(_) => {}
            _ => self.height -= 1,
        }
        if self.height > MAX_STACK {
            return Err(self.wrong("the formula is nested too deeply"));
        }
        self.steps.push(step);
        Ok(())
    }

    /// Reads the next token. Blanks and underscores between tokens are skipped.
    fn advance(&mut self) -> Result<(), FormulaError> {
        let rest = self.text[self.at..].trim_start_matches(|c: char| c.is_whitespace() || c == '_');
        let start = self.text.len() - rest.len();
        let (token, length) = match rest.chars().next() {
            None => (Token::End, 0),
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(start, rest)?,
            Some(c) if c.is_ascii_alphabetic() => {
                let length = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
                (Token::Name(&rest[..length]), length)
            }
            Some(c) if "+-*/^(),".contains(c) => (Token::Symbol(c), 1),
            Some(c) => {
                let message = format!("`{}` has no meaning in a formula", c.escape_debug());
                return Err(FormulaError { at: start..start + c.len_utf8(), message });
            }
        };
        self.token = token;
        self.span = start..start + length;
        self.at = start + length;
        Ok(())
    }

    fn number(&self, start: usize, rest: &'a str) -> Result<(Token<'a>, usize), FormulaError> {
        let digits = |s: &str| s.bytes().take_while(u8::is_ascii_digit).count();
        let mut length = digits(rest);
        if rest[length..].starts_with('.') {
            length += 1 + digits(&rest[length + 1..]);
        }
        if rest[length..].starts_with(['e', 'E']) {
            let sign = usize::from(rest[length + 1..].starts_with(['+', '-']));
            let exponent = digits(&rest[length + 1 + sign..]);
            if exponent > 0 {
                length += 1 + sign + exponent;
            }
        }
        match rest[..length].parse::<f64>() {
            Ok(value) => Ok((Token::Number(value), length)),
            Err(_) => {
                let message = format!("`{}` is not a number", &rest[..length]);
                Err(FormulaError { at: start..start + length, message })
            }
        }
    }

    fn unexpected(&self, expected: &str) -> FormulaError {
        let found = match self.token {
            Token::End => "the formula ends".to_owned(),
            _ => format!("found `{}`", &self.text[self.span.clone()]),
        };
        self.wrong(&format!("{found} where {expected} is expected"))
    }

    fn wrong(&self, message: &str) -> FormulaError {
        FormulaError { at: self.span.clone(), message: message.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value(text: &str, t: f64) -> f64 {
        Formula::parse(text).unwrap_or_else(|e| panic!("{text}: {e:?}")).eval(t)
    }

    fn complaint(text: &str) -> (Range<usize>, String) {
        let e = Formula::parse(text).expect_err(text);
        (e.at, e.message)
    }

    #[test]
    fn precedence_and_associativity() {
        assert_eq!(value("1+2*3", 0.0), 7.0);
        assert_eq!(value("8-4-2", 0.0), 2.0);
        assert_eq!(value("16/4/2", 0.0), 2.0);
        assert_eq!(value("2^3^2", 0.0), 64.0);
        assert_eq!(value("2*t^2+1", 3.0), 19.0);
        assert_eq!(value("(1+2)*3", 0.0), 9.0);
        assert_eq!(value("2^0.5", 0.0), libm::pow(2.0, 0.5));
    }

    #[test]
    fn signs_stand_anywhere() {
        assert_eq!(value("-sin(t)", 1.0), -libm::sin(1.0));
        assert_eq!(value("2*-t", 3.0), -6.0);
        assert_eq!(value("-pi", 0.0), -PI);
        assert_eq!(value("-t^2", 3.0), -9.0);
        assert_eq!(value("t^-1", 4.0), 0.25);
        assert_eq!(value("1 - -1", 0.0), 2.0);
        assert_eq!(value("atan2(-t,-1)", 1.0), libm::atan2(-1.0, -1.0));
    }

    #[test]
    fn names_numbers_and_noise() {
        assert_eq!(value("0.0005*sin(2*THETA)", 0.4), 0.0005 * libm::sin(0.8));
        assert_eq!(value("2e-5 + .5 + 1.", 0.0), 2e-5 + 0.5 + 1.0);
        assert_eq!(value("2*e", 0.0), 2.0 * E);
        assert_eq!(value(" t _+ 1 ", 1.0), 2.0);
        assert_eq!(value("t^0", 5.0), 1.0);
        assert_eq!(value("t^1", 5.0), 5.0);
        assert_eq!(value("0.1^3", 0.0), 0.1 * 0.1 * 0.1);
    }

    #[test]
    fn errors_mark_the_place() {
        assert_eq!(complaint("1+sine(t)").0, 2..6);
        assert!(complaint("1+sine(t)").1.contains("did you mean `sin`"));
        assert_eq!(complaint("2 t").0, 2..3);
        assert_eq!(complaint("(1+2").0, 4..4);
        assert_eq!(complaint("sin t").0, 4..5);
        assert_eq!(complaint("1..2").0, 2..4);
        assert_eq!(complaint("t$2").0, 1..2);
        assert_eq!(complaint("").0, 0..0);
        assert!(complaint("atan2(t)").1.contains("`,`"));
    }

    #[test]
    fn values_that_are_no_numbers_are_told_with_formula_and_argument() {
        let check = |text: &str, t: f64| {
            Formula::parse(text).unwrap().number("range error", t).map_err(|e| e.to_string())
        };
        assert_eq!(check("1/THETA", 0.5), Ok(2.0));
        let message = check("1/THETA", 0.0).unwrap_err();
        assert!(
            message.starts_with("the formula of the range error, `1/THETA`, is inf at 0, expected"),
            "{message}"
        );
        assert!(check("sqrt(t)", -1.0).unwrap_err().contains("is NaN at -1,"));
        assert!(check("exp(t)", 100.0).unwrap_err().contains("e43 at 100,"));
    }

    #[test]
    fn hostile_nesting_is_refused() {
        for text in ["(".repeat(100_000), "sin(".repeat(100_000), "2^(".repeat(100_000)] {
            assert!(complaint(&text).1.contains("deeply"));
        }
        assert_eq!(value(&format!("{}1", "-".repeat(100_001)), 0.0), -1.0);
        assert_eq!(value(&format!("1{}", "+1".repeat(100_000)), 0.0), 100_001.0);
    }

    proptest! {
        #[test]
        fn any_text_is_answered(text in "[-+*/^(),.0-9a-zA-Z é_]{0,60}") {
            if let Ok(formula) = Formula::parse(&text) {
                formula.eval(0.7);
            }
        }

        #[test]
        fn numbers_are_read_as_rust_reads_them(x in 0.0..1e300f64) {
            prop_assert_eq!(value(&format!("{x:e}"), 0.0), x);
        }
    }
}
