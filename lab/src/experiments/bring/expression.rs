//! Formulas in `a` and `b`, such as `a - 2*dot(a,b)*b`: read, checked, and evaluated.

use serde::{Deserialize, Serialize};

use super::wanted::Type;
use rayo::internals::reference::aos::{self, Form, Scalar};
use rayo::internals::scene::brief;

/// A formula whose parts have the types that its operations take.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Expression {
    text: String,
    root: Node,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
enum Node {
    Number(f32),
    /// Numbers of an argument: which argument, the first of them, and how many.
    Part(usize, usize, Type),
    Minus(Box<Node>),
    Binary(Sign, Box<Node>, Box<Node>),
    Call(Function, Vec<Node>),
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Sign {
    Plus,
    Minus,
    Times,
    Over,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Function {
    Dot,
    Norm,
    Cross,
    Normalise,
    Sqrt,
    Abs,
    Min,
    Max,
}

impl Function {
    const ALL: [(&'static str, Function); 8] = [
        ("dot", Function::Dot),
        ("norm", Function::Norm),
        ("cross", Function::Cross),
        ("normalise", Function::Normalise),
        ("sqrt", Function::Sqrt),
        ("abs", Function::Abs),
        ("min", Function::Min),
        ("max", Function::Max),
    ];

    /// The types of its arguments, and of its result.
    fn signature(self) -> (&'static [Type], Type) {
        match self {
            Function::Dot => (&[Type::Vec4, Type::Vec4], Type::F32),
            Function::Norm => (&[Type::Vec4], Type::F32),
            Function::Cross => (&[Type::Vec4, Type::Vec4], Type::Vec4),
            Function::Normalise => (&[Type::Vec4], Type::Vec4),
            Function::Sqrt | Function::Abs => (&[Type::F32], Type::F32),
            Function::Min | Function::Max => (&[Type::F32, Type::F32], Type::F32),
        }
    }
}

/// What is deeper is refused, before it fills the stack.
const MOST_DEEP: usize = 100;
/// A longer formula is refused.
const MOST_CHARACTERS: usize = 10_000;

impl Expression {
    /// Reads a formula in arguments of these types.
    ///
    /// # Errors
    /// Where it is not one, and what was expected there.
    pub fn read(text: &str, takes: &[Type], gives: Type) -> Result<Self, String> {
        if text.len() > MOST_CHARACTERS {
            return Err(format!("a formula has at most {MOST_CHARACTERS} characters"));
        }
        let mut reader = Reader { text, at: 0, takes, depth: 0 };
        let root = reader.sum()?;
        if let Some(c) = reader.peek() {
            return Err(reader.wrong(&format!("expected an operator or the end, not `{c}`")));
        }
        let kind = root.kind();
        if kind != gives {
            return Err(format!("the formula `{}` gives {kind}, and the function {gives}", brief(text)));
        }
        Ok(Expression { text: text.trim().to_owned(), root })
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    /// Its value for the numbers of the arguments, by the operations in their order.
    pub fn evaluate<S: Scalar>(&self, arguments: &[Vec<S>]) -> Vec<S> {
        self.root.evaluate(arguments)
    }
}

impl Node {
    fn kind(&self) -> Type {
        match self {
            Node::Number(_) => Type::F32,
            Node::Part(.., kind) => *kind,
            Node::Minus(inner) => inner.kind(),
            Node::Binary(_, a, b) => {
                let vector = [a, b].into_iter().any(|operand| operand.kind() == Type::Vec4);
                if vector { Type::Vec4 } else { Type::F32 }
            }
            Node::Call(function, _) => function.signature().1,
        }
    }

    fn evaluate<S: Scalar>(&self, arguments: &[Vec<S>]) -> Vec<S> {
        match self {
            Node::Number(number) => vec![S::from(*number)],
            Node::Part(argument, first, kind) => arguments[*argument][*first..first + kind.numbers()].to_vec(),
            Node::Minus(inner) => inner.evaluate(arguments).into_iter().map(|x| S::from(-0.0) - x).collect(),
            Node::Binary(sign, a, b) => {
                let (a, b) = (a.evaluate(arguments), b.evaluate(arguments));
                // A scalar is the operand of every lane.
                let lanes = a.len().max(b.len());
                let lane = |of: &[S], index: usize| of[index % of.len()];
                (0..lanes).map(|index| sign.apply(lane(&a, index), lane(&b, index))).collect()
            }
            Node::Call(function, inner) => {
                let values: Vec<_> = inner.iter().map(|node| node.evaluate(arguments)).collect();
                function.apply(&values)
            }
        }
    }
}

impl Sign {
    fn apply<S: Scalar>(self, a: S, b: S) -> S {
        match self {
            Sign::Plus => a + b,
            Sign::Minus => a - b,
            Sign::Times => a * b,
            Sign::Over => a / b,
        }
    }
}

impl Function {
    fn apply<S: Scalar>(self, values: &[Vec<S>]) -> Vec<S> {
        let vector = |index: usize| -> aos::Lanes<S> { values[index][..4].try_into().expect("a vector") };
        let scalar = |index: usize| values[index][0];
        match self {
            Function::Dot => vec![aos::dot(Form::Paper, vector(0), vector(1))],
            Function::Norm => vec![aos::norm(Form::Paper, vector(0))],
            Function::Cross => aos::cross(vector(0), vector(1)).to_vec(),
            Function::Normalise => aos::normalise(Form::Paper, vector(0)).to_vec(),
            Function::Sqrt => vec![scalar(0).sqrt()],
            Function::Abs => vec![scalar(0).abs()],
            Function::Min => vec![if scalar(0) < scalar(1) { scalar(0) } else { scalar(1) }],
            Function::Max => vec![if scalar(0) > scalar(1) { scalar(0) } else { scalar(1) }],
        }
    }
}

/// A formula that is being read.
struct Reader<'a> {
    text: &'a str,
    /// Bytes that were read.
    at: usize,
    takes: &'a [Type],
    depth: usize,
}

impl Reader<'_> {
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    /// Whether `c` comes next, which is then read.
    fn takes_sign(&mut self, c: char) -> bool {
        let comes = self.peek() == Some(c);
        self.at += if comes { c.len_utf8() } else { 0 };
        comes
    }

    fn wrong(&self, what: &str) -> String {
        let column = self.text[..self.at].chars().count() + 1;
        format!("the formula `{}`, column {column}: {what}", brief(self.text))
    }

    fn sum(&mut self) -> Result<Node, String> {
        self.depth += 1;
        if self.depth > MOST_DEEP {
            return Err(self.wrong(&format!("more than {MOST_DEEP} parentheses within each other")));
        }
        let mut left = self.product()?;
        loop {
            let sign = match self.peek() {
                Some('+') => Sign::Plus,
                Some('-') => Sign::Minus,
                _ => break,
            };
            self.at += 1;
            let right = self.product()?;
            left = self.binary(sign, left, right)?;
        }
        self.depth -= 1;
        Ok(left)
    }

    fn product(&mut self) -> Result<Node, String> {
        let mut left = self.factor()?;
        loop {
            let sign = match self.peek() {
                Some('*') => Sign::Times,
                Some('/') => Sign::Over,
                _ => return Ok(left),
            };
            self.at += 1;
            let right = self.factor()?;
            left = self.binary(sign, left, right)?;
        }
    }

    fn binary(&self, sign: Sign, left: Node, right: Node) -> Result<Node, String> {
        let kinds = [left.kind(), right.kind()];
        if kinds.iter().any(|kind| ![Type::F32, Type::Vec4].contains(kind)) {
            return Err(self.wrong("a record has no sum or product: name one of its fields"));
        }
        if kinds == [Type::Vec4; 2] && [Sign::Times, Sign::Over].contains(&sign) {
            return Err(self.wrong("two vectors have no product: dot(x, y) or cross(x, y) is meant"));
        }
        if kinds[0] != kinds[1] && [Sign::Plus, Sign::Minus].contains(&sign) {
            return Err(self.wrong("a vector and a number have no sum"));
        }
        Ok(Node::Binary(sign, Box::new(left), Box::new(right)))
    }

    fn factor(&mut self) -> Result<Node, String> {
        let Some(c) = self.peek() else { return Err(self.wrong("it ends where a value is expected")) };
        if self.takes_sign('-') {
            self.depth += 1;
            if self.depth > MOST_DEEP {
                return Err(self.wrong("too many signs"));
            }
            let inner = self.factor()?;
            self.depth -= 1;
            return Ok(Node::Minus(Box::new(inner)));
        }
        if self.takes_sign('(') {
            let inner = self.sum()?;
            return if self.takes_sign(')') { Ok(inner) } else { Err(self.wrong("expected `)`")) };
        }
        if c.is_ascii_digit() || c == '.' {
            return self.number();
        }
        if c.is_ascii_alphabetic() {
            return self.name();
        }
        Err(self.wrong(&format!("expected a value, not `{c}`")))
    }

    /// Reads the characters up to the first one of which `is_part` does not hold.
    fn word(&mut self, is_part: impl Fn(char) -> bool) -> &str {
        let rest = &self.text[self.at..];
        let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        self.at += end;
        &self.text[self.at - end..self.at]
    }

    fn number(&mut self) -> Result<Node, String> {
        let word = self.word(|c| c.is_ascii_digit() || c == '.').to_owned();
        word.parse().map(Node::Number).map_err(|_| self.wrong(&format!("`{word}` is no number")))
    }

    fn name(&mut self) -> Result<Node, String> {
        let word = self.word(|c| c.is_ascii_alphanumeric() || c == '_').to_owned();
        let argument = ["a", "b"].iter().position(|name| *name == word).filter(|index| *index < self.takes.len());
        if let Some(argument) = argument {
            return self.fields(Node::Part(argument, 0, self.takes[argument]));
        }
        let Some((_, function)) = Function::ALL.into_iter().find(|(name, _)| *name == word) else {
            let arguments = &["a", "b"][..self.takes.len().min(2)];
            let known = Function::ALL.map(|(name, _)| name).join(", ");
            let what = format!("there is no `{}`; there are {}, and {known}", brief(&word), arguments.join(", "));
            return Err(self.wrong(&what));
        };
        if !self.takes_sign('(') {
            return Err(self.wrong("expected `(`"));
        }
        let mut inner = vec![self.sum()?];
        while self.takes_sign(',') {
            inner.push(self.sum()?);
        }
        if !self.takes_sign(')') {
            return Err(self.wrong("expected `)`"));
        }
        let (takes, gives) = function.signature();
        let kinds: Vec<_> = inner.iter().map(Node::kind).collect();
        if kinds != takes {
            let list = |kinds: &[Type]| kinds.iter().map(|kind| kind.name()).collect::<Vec<_>>().join(", ");
            return Err(self.wrong(&format!("{word} takes ({}), not ({})", list(takes), list(&kinds))));
        }
        let call = Node::Call(function, inner);
        // A component of a vector result has no place in an argument.
        if gives == Type::Vec4 && self.peek() == Some('.') {
            return Err(self.wrong("only a and b have fields"));
        }
        Ok(call)
    }

    fn fields(&mut self, mut part: Node) -> Result<Node, String> {
        while self.takes_sign('.') {
            let word = self.word(|c| c.is_ascii_alphanumeric()).to_owned();
            let Node::Part(argument, first, kind) = part else { break };
            let Some((_, offset, field)) = kind.fields().iter().find(|(name, ..)| *name == word) else {
                let known: Vec<_> = kind.fields().iter().map(|(name, ..)| *name).collect();
                let what = format!("{kind} has no field `{}`; it has: {}", brief(&word), known.join(", "));
                return Err(self.wrong(&what));
            };
            part = Node::Part(argument, first + offset, *field);
        }
        Ok(part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_formula_is_its_operations_in_their_order() {
        let takes = [Type::Vec4, Type::Vec4];
        let reflected = Expression::read("a - 2*dot(a,b)*b", &takes, Type::Vec4).unwrap();
        let arguments = [vec![1.0_f32, -2.0, 3.0, 0.0], vec![0.0, 1.0, 0.0, 0.0]];
        assert_eq!(reflected.evaluate(&arguments), [1.0, 2.0, 3.0, 0.0]);
        let value = |text: &str| Expression::read(text, &takes, Type::F32).unwrap().evaluate(&arguments)[0];
        assert_eq!(value("1 + 2 * 3 - 4 / 2"), 5.0);
        assert_eq!(value("-(a.x - a.z) * sqrt(4)"), 4.0);
        assert_eq!(value("max(a.y, norm(b)) + min(2, abs(a.y))"), 3.0);
    }

    #[test]
    fn what_is_no_formula_is_told_with_its_column() {
        let takes = [Type::Vec4, Type::Sphere];
        for (text, said) in [
            ("", "column 1: it ends where a value is expected"),
            ("a + ", "column 5: it ends"),
            ("a * a", "two vectors have no product"),
            ("a + 1", "a vector and a number have no sum"),
            ("b + b", "a record has no sum"),
            ("dot(a)", "dot takes (vec4, vec4), not (vec4)"),
            ("c", "there is no `c`; there are a, b, and dot"),
            ("b.size", "sphere has no field `size`; it has: centre, colour, radius"),
            ("a.x", "gives f32, and the function vec4"),
            ("(a", "expected `)`"),
            ("a)", "expected an operator or the end, not `)`"),
            ("1.2.3", "is no number"),
            ("§", "expected a value, not `§`"),
        ] {
            let error = Expression::read(text, &takes, Type::Vec4).unwrap_err();
            assert!(error.contains(said), "{text}: {error}");
        }
        let deep = "(".repeat(5000) + &"-".repeat(4000);
        assert!(Expression::read(&deep, &takes, Type::Vec4).unwrap_err().contains("more than 100"));
    }
}
