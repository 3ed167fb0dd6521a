//! The verdict on a function as text: a line for each check, what fails, and the figures.

use std::fmt::Write as _;

use super::super::{BOLD, DIM, GREEN, RED, styled};
use rayo::internals::plan::with_digit_groups;
use rayo_lab::experiments::bring::findings::{Check, Crash, Example, Picture, Ratio, Step};
use rayo_lab::experiments::bring::lines::Line;
use rayo_lab::experiments::bring::verdict::{FaultsVerdict, Figures, Verdict};
use rayo_lab::experiments::bring::wanted::TRACE;
use rayo_lab::measure::instructions::Instruction;

/// The columns of a check's name.
const NAME: usize = 13;

/// The text of a verdict, in colours if there are any.
pub fn text(verdict: &Verdict, colour: bool) -> String {
    let mut page = Page { text: String::new(), colour };
    let head = format!("{}: {}", verdict.file, verdict.op);
    page.line(&page.styled(BOLD, &head));
    if verdict.pictures.is_empty() {
        page.result(verdict);
    } else {
        page.pictures(verdict);
    }
    // What is wrong for ordinary numbers need not be shown for others too; a tracer has pictures
    // alone.
    if verdict.op != TRACE {
        if verdict.result.holds != Some(false) {
            page.check("odd numbers", &verdict.odd, "infinities, NaN and denormal numbers as they have to be");
            page.fourth_lane(verdict);
        }
        let fine = "the same result in the place of an argument, or for twice the same one";
        page.faults("aliasing", &verdict.aliasing, fine);
    }
    if let Some(is_proved) = verdict.proof.holds {
        page.named("proof", is_proved.then_some(true), &verdict.proof.says);
    }
    page.faults("convention", &verdict.convention, "kept: registers, stack, direction flag, MXCSR");
    page.faults("memory", &verdict.memory, &extents(verdict));
    if let Some(crash) = &verdict.crash {
        page.crash(crash);
    }
    page.instructions(verdict);
    page.figures(verdict);
    page.ratios(verdict);
    page.steps(verdict);
    page.printed(verdict);
    for note in &verdict.notes {
        page.named("", None, note);
    }
    if !verdict.holds && verdict.crash.is_none() {
        page.named("", Some(false), &format!("does not hold: {}", verdict.broken.join("; ")));
    }
    page.text
}

/// What the function reads and writes where it is right.
fn extents(verdict: &Verdict) -> String {
    if verdict.reads.is_empty() {
        return "nothing beside the frame, the lists, the objects and the picture".into();
    }
    let reads = verdict.reads.iter().map(usize::to_string).collect::<Vec<_>>().join(" + ");
    format!("reads {reads} bytes, writes {}; nothing beyond", verdict.writes)
}

struct Page {
    text: String,
    colour: bool,
}

impl Page {
    fn styled(&self, code: &str, text: &str) -> String {
        styled(self.colour, code, text)
    }

    fn line(&mut self, line: &str) {
        self.text += line;
        self.text.push('\n');
    }

    /// A check with its verdict.
    fn named(&mut self, name: &str, holds: Option<bool>, says: &str) {
        let style = match holds {
            Some(true) => GREEN,
            Some(false) => RED,
            None => "0",
        };
        let says = if holds.is_some() { self.styled(style, says) } else { says.to_owned() };
        self.line(&format!("  {name:<NAME$} {says}"));
    }

    fn more(&mut self, text: &str) {
        self.line(&format!("  {:<NAME$} {text}", ""));
    }

    fn result(&mut self, verdict: &Verdict) {
        let result = &verdict.result;
        let Some(holds) = result.holds else { return };
        let inputs = thousands(result.inputs + verdict.odd.inputs + verdict.fourth_lane.inputs);
        if let Some(form) = &result.same_bits {
            let says = match form.contains(' ') {
                true => format!("the same bits as {form}, for {inputs} inputs, odd numbers among them"),
                false => format!("the same bits as `{form}` for {inputs} inputs, odd numbers among them"),
            };
            return self.named("result", Some(true), &says);
        }
        if holds {
            let inputs = thousands(result.inputs);
            let says =
                format!("another order of operations: all of {inputs} results are within the bound of any order");
            self.named("result", Some(true), &says);
            if let (Some(ulp), Some(expected)) = (result.max_ulp, result.max_ulp_expected) {
                let twin = if verdict.against.is_empty() { "the formula as it is written" } else { "`paper`" };
                self.more(&format!("the largest error is {ulp:.2} ulp; {twin} has {expected:.2}"));
            }
            return;
        }
        let (wrong, inputs) = (thousands(result.outside), thousands(result.inputs));
        let large = result
            .max_ulp
            .filter(|ulp| (10.0..1e6).contains(ulp))
            .map_or(String::new(), |ulp| format!(", by up to {ulp:.0} ulp"));
        self.named("result", Some(false), &format!("wrong: {wrong} of {inputs} results{large}"));
        self.example(result.worst.as_ref());
    }

    /// A tracer's pictures beside the reference's.
    fn pictures(&mut self, verdict: &Verdict) {
        for (index, picture) in verdict.pictures.iter().enumerate() {
            let Picture { scene, width, height, wrong, allowed, largest, at, .. } = picture;
            let size = format!("{scene} at {width}x{height}");
            let says = if picture.same_bits {
                format!("{size}: the same bits as `paper`")
            } else {
                let pixels = u64::from(*width) * u64::from(*height);
                let place = at.map_or(String::new(), |(x, y)| format!(" at ({x}, {y})"));
                format!(
                    "{size}: {wrong} of {} pixels are off by more than 1/255 ({allowed} may be, at outlines); the largest \
                     difference is {largest:.3}{place}",
                    thousands(pixels)
                )
            };
            self.named(if index == 0 { "picture" } else { "" }, Some(wrong <= allowed), &says);
        }
    }

    /// A tracer's time as a multiple of others'.
    fn ratios(&mut self, verdict: &Verdict) {
        for ratio in &verdict.ratios {
            let Ratio { scene, what, ratio, low, high, per_pixel } = ratio;
            let says = format!("{what} {ratio:.2} ({low:.2} to {high:.2}); {per_pixel:.1} cycles a pixel");
            self.line(&format!("  {scene:<18} {says}"));
        }
    }

    /// A call, instruction by instruction.
    fn steps(&mut self, verdict: &Verdict) {
        for Step { text, line, changed } in &verdict.steps {
            let number = line.as_ref().map_or(String::new(), |line| format!("{}:{}", line.file, line.line));
            let source = line.as_ref().map_or("", |line| line.text.as_str());
            let changed: Vec<_> = changed.iter().map(|(name, value)| format!("{name} = {value}")).collect();
            // What the source says beside the instruction, if that is a macro or a line of C.
            let bare = |text: &str| text.split(';').next().unwrap_or_default().replace(' ', "").to_lowercase();
            let beside = if bare(source) == bare(text) { String::new() } else { format!("   | {}", source.trim()) };
            self.line(&format!("  {number:<22} {text:<32} {}{}", changed.join(", "), self.styled(DIM, &beside)));
        }
    }

    fn check(&mut self, name: &str, check: &Check, fine: &str) {
        match check.holds {
            None => {}
            Some(true) => self.named(name, Some(true), fine),
            Some(false) => {
                let (wrong, inputs) = (thousands(check.failed), thousands(check.inputs));
                self.named(name, Some(false), &format!("wrong: {wrong} of {inputs} results"));
                self.example(check.worst.as_ref());
            }
        }
    }

    fn fourth_lane(&mut self, verdict: &Verdict) {
        let lane = &verdict.fourth_lane;
        if lane.holds.is_some() {
            self.named("fourth lane", lane.holds, &lane.says);
            self.example(lane.worst.as_ref());
        }
    }

    /// An input with its results, lane by lane.
    fn example(&mut self, example: Option<&Example>) {
        let Some(example) = example else { return };
        self.arguments(&example.arguments);
        let is_scalar = example.lanes.len() == 1;
        for (lane, name) in example.lanes.iter().zip(["x", "y", "z", "w"]) {
            let name = if is_scalar { "result".into() } else { format!("result.{name}") };
            let mark = if lane.is_right { "" } else { "  <- wrong" };
            self.more(&format!("  {name:<9} expected {}, got {}{mark}", lane.expected, lane.got));
        }
    }

    fn arguments(&mut self, arguments: &[(String, Vec<String>)]) {
        for (name, numbers) in arguments {
            self.more(&format!("  {name:<9} {}", numbers.join(", ")));
        }
    }

    fn faults(&mut self, name: &str, check: &FaultsVerdict, fine: &str) {
        match check.holds {
            None => {}
            Some(true) => self.named(name, Some(true), fine),
            Some(false) => {
                for (index, fault) in check.faults.iter().enumerate() {
                    self.named(if index == 0 { name } else { "" }, Some(false), &fault.rule);
                    self.place(fault.instruction.as_deref(), fault.line.as_ref());
                }
            }
        }
    }

    /// An instruction with its line, as far as they are known.
    fn place(&mut self, instruction: Option<&str>, line: Option<&Line>) {
        let line = line.map(|Line { file, line, text }| match text.is_empty() {
            true => format!("{file}:{line}"),
            false => format!("{file}:{line}: {text}"),
        });
        match (instruction, line) {
            (Some(instruction), Some(line)) => self.more(&format!("  {instruction}   ({line})")),
            (Some(one), None) => self.more(&format!("  {one}")),
            (None, Some(one)) => self.more(&format!("  {one}")),
            (None, None) => {}
        }
    }

    fn crash(&mut self, crash: &Crash) {
        self.named("crash", Some(false), &crash.what);
        self.place(crash.instruction.as_deref(), crash.line.as_ref());
        if let Some(cause) = &crash.cause {
            self.more(&format!("  {cause}"));
        }
        self.arguments(&crash.arguments);
    }

    /// The kinds of the function's instructions.
    fn instructions(&mut self, verdict: &Verdict) {
        let Some(mix) = &verdict.instructions.mix else { return };
        let kinds = [
            (mix.load, "load"),
            (mix.arithmetic, "compute"),
            (mix.shuffle, "shuffle"),
            (mix.r#move, "copy"),
            (mix.store, "store"),
            (mix.branch, "branch"),
            (mix.other, "other"),
        ];
        let kinds: Vec<_> =
            kinds.iter().filter(|(count, _)| *count > 0).map(|(count, kind)| format!("{count} {kind}")).collect();
        let plain =
            ["INTEL8086", "INTEL286", "INTEL386", "X64", "INTEL486", "INTEL186", "CET_IBT", "MULTIBYTENOP", "FPU"];
        let sets: Vec<_> = mix.features.iter().map(String::as_str).filter(|set| !plain.contains(set)).collect();
        let sets = if sets.is_empty() { String::new() } else { format!("; needs {}", sets.join(", ")) };
        self.named("code", None, &format!("{}{sets}", kinds.join(", ")));
    }

    /// Ours beside those of the implementations that it is held against.
    fn figures(&mut self, verdict: &Verdict) {
        let Some(function) = verdict.instructions.function else { return };
        let yours = Figures {
            function: Some(function),
            body: verdict.instructions.body,
            executed: verdict.instructions.executed,
            ..verdict.figures.clone()
        };
        let others = ["paper", "aos", "c-O3", "glam"];
        let others: Vec<_> = others.iter().filter_map(|name| Some((*name, verdict.against.get(*name)?))).collect();
        let columns: Vec<_> = [("yours", &yours)].into_iter().chain(others).collect();
        let mut head = format!("  {:<18}", "");
        columns.iter().for_each(|(name, _)| write!(head, "{name:>8}").expect("a string"));
        self.line(&self.styled(DIM, &head));
        let whole = |count: Option<usize>| count.map(|count| count.to_string());
        let cycles = |cycles: Option<f64>| cycles.map(|c| if c < 9.95 { format!("{c:.1}") } else { format!("{c:.0}") });
        self.row("instructions", &columns, |figures| whole(figures.function));
        self.row("  body", &columns, |figures| whole(figures.body));
        self.row("  executed", &columns, |figures| figures.executed.map(|count| count.to_string()));
        let latency = if verdict.pictures.is_empty() { "latency, cycles" } else { "cycles a pixel" };
        self.row(latency, &columns, |figures| cycles(figures.latency));
        self.row("one every ...", &columns, |figures| cycles(figures.throughput));
    }

    /// A row of figures, unless nothing of it is known.
    fn row(&mut self, name: &str, columns: &[(&str, &Figures)], cell: impl Fn(&Figures) -> Option<String>) {
        let cells: Vec<_> = columns.iter().map(|(_, figures)| cell(figures)).collect();
        if cells[0].is_none() {
            return;
        }
        let mut line = format!("  {name:<18}");
        for cell in cells {
            write!(line, "{:>8}", cell.unwrap_or("-".into())).expect("a string");
        }
        self.line(&line);
    }

    fn printed(&mut self, verdict: &Verdict) {
        const MOST: usize = 5;
        if verdict.printed.is_empty() {
            return;
        }
        self.named("printed", None, &format!("{} bytes, which no caller expects:", verdict.printed.len()));
        for line in verdict.printed.lines().take(MOST) {
            self.more(&format!("  {}", line.chars().take(90).collect::<String>()));
        }
        if verdict.printed.lines().nth(MOST).is_some() {
            self.more("  ...");
        }
    }
}

fn thousands(number: u64) -> String {
    with_digit_groups(number, ',')
}

/// The instructions of a function beside those of `paper`.
pub fn listing(file: &str, yours: &[Instruction], paper: &[Instruction]) -> String {
    const WIDTH: usize = 44;
    let mut text = format!("{:<WIDTH$} paper\n", format!("{file}, {} instructions", yours.len()));
    let line = |of: Option<&Instruction>| of.map_or(String::new(), |of| format!("{:>4x}  {}", of.offset, of.text));
    for index in 0..yours.len().max(paper.len()) {
        let [left, right] = [yours, paper].map(|of| line(of.get(index)));
        text += format!("{left:<WIDTH$} {right}").trim_end();
        text.push('\n');
    }
    text
}
