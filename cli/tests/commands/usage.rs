//! Help, completion, and what is mistyped: options, values, engines.

use crate::place::{Place, engines, invalid};
use rayo::internals::render::Engine;
use std::fs;

// Help and usage

#[test]
fn help_lists_the_commands_and_each_has_its_own() {
    let place = Place::new();
    let help = place.run("--help");
    assert_eq!((help.status, help.stderr.as_str()), (0, ""));
    assert!(help.stdout.contains("Usage: rayo <COMMAND>"), "{}", help.stdout);
    assert!(help.stdout.contains("Exit status: 0 done, 1"), "{}", help.stdout);
    let commands =
        help.stdout.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let commands: Vec<_> = commands
        .filter_map(|line| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')))
        .map(|line| line.split(' ').next().unwrap())
        .collect();
    for name in ["render", "convert", "make", "diff", "info"] {
        assert!(commands.contains(&name), "{commands:?}");
    }
    for name in commands.iter().filter(|name| **name != "help") {
        let own = place.run(&format!("{name} --help"));
        assert_eq!((own.status, own.stderr.as_str()), (0, ""), "{name}");
        assert!(own.stdout.contains(&format!("Usage: rayo {name}")), "{}", own.stdout);
        let short = place.run(&format!("{name} -h"));
        assert_eq!((short.status, short.stderr.as_str()), (0, ""), "{name}");
        assert_eq!(place.run(&format!("help {name}")).stdout, own.stdout);
    }
}

#[test]
fn shells_complete_and_manuals_have_every_command() {
    let place = Place::new();
    let bash = place.run("completions bash");
    assert_eq!((bash.status, bash.stderr.as_str()), (0, ""));
    for word in ["render", "--engine", "stability"] {
        assert!(bash.stdout.contains(word), "{word}");
    }
    assert_eq!(place.run("completions tcsh").status, 2);
    let page = place.run("man").stdout;
    assert!(page.starts_with(".ie") && page.contains("render"), "{page}");
    assert_eq!(place.run("man --out pages").status, 0);
    let named = page.lines().filter_map(|line| line.strip_suffix("(1)")).map(|name| name.replace('\\', ""));
    let named: Vec<_> = named.collect();
    assert!(named.len() > 10 && named.contains(&"rayo-step".into()), "{named:?}");
    for name in named {
        let page = fs::read_to_string(place.path("pages").join(format!("{name}.1"))).expect(&name);
        assert!(page.contains(".SH EXAMPLES\n  rayo "), "{page}");
    }
}

#[test]
fn without_arguments_the_help_is_shown_and_that_is_bad_usage() {
    let run = Place::new().run("");
    assert_eq!((run.status, run.stdout.as_str()), (2, ""));
    assert!(run.stderr.contains("Usage: rayo <COMMAND>") && run.stderr.contains("render"), "{}", run.stderr);
}

#[test]
fn what_is_mistyped_is_met_with_a_suggestion() {
    let place = Place::new();
    for (arguments, suggestion) in [
        ("rendr scene.in", "subcommands exist: 'report', 'render'"),
        ("render scene.in --engin c", "tip: a similar argument exists: '--engine'"),
        ("render scene.in --ouput x.png", "tip: a similar argument exists: '--output'"),
        ("render", "<SCENE>"),
        ("diff a.png", "<B>"),
    ] {
        let run = place.run(arguments);
        assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{arguments}");
        assert!(run.stderr.starts_with("error: ") && run.stderr.contains(suggestion), "{arguments}: {}", run.stderr);
    }
    assert_eq!(place.files(), ["scene.in"]);
}

#[test]
fn a_value_that_cannot_be_is_refused_with_what_was_expected() {
    let place = Place::new();
    let refuses = |arguments: &str, message: &str| {
        place.refuses(&format!("render scene.in -o x.png {arguments}"), 2, message);
    };
    let size = "expected width and height in pixels, as in 1632x1224, or one of them, as in 800x or x600";
    let float = "expected a number greater than 0, from 1e-45 to 3.4e38";
    for (option, name, values, expected) in [
        ("--size", "<WxH>", "axb 5 x 5xx -1x5 4294967296x1", size),
        ("--film", "<DIAGONAL>", "one 1e400 1e-50", float),
        ("--threads", "<N>", "0 -2 1025 two", "expected a whole number from 1 to 1024"),
        ("--orbit", "<N>", "0 100001 1.5", "expected a whole number from 1 to 100000"),
        ("--rows", "<A..B>", "-1..2 2..1", "expected the first row and the one after the last, as in 0..100"),
    ] {
        for value in values.split(' ') {
            refuses(&format!("{option} {value}"), &invalid(value, &format!("{option} {name}"), expected));
        }
    }
    let side = "each side of an image must be from 1 to 65535 pixels";
    for (size, shown) in [("0x5", "0x5"), ("65536x1", "65536x1"), ("x65536", "87381x65536")] {
        refuses(&format!("--size {size}"), &format!("error: {side}, not {shown}"));
    }
    refuses("--size 65535x32769", "error: an image of 65535x32769 has more than 2147483648 pixels");
    for (argument, shown) in [("--film -1", "-1"), ("--film 0", "0"), ("--film nan", "NaN"), ("--film -inf", "-inf")] {
        refuses(argument, &format!("error: the film diagonal must be a finite number greater than 0, not {shown}"));
    }
    for value in ["inf", "-2.5"] {
        let message = format!("error: the focal distance must be a finite number greater than 0, not {value}");
        refuses(&format!("--focal {value}"), &message);
    }
    assert_eq!(place.files(), ["scene.in"]);
}

// Engines

#[test]
fn an_unknown_engine_or_precision_is_refused_with_a_list() {
    let place = Place::new();
    // Those that only this CPU lacks are among them.
    let all = engines(|_| true);
    for (arguments, message) in [
        ("--engine nope", format!("error: there is no engine `nope`; this build has: {all}")),
        ("--engine Rust", format!("error: there is no engine `Rust`, did you mean `rust`?; this build has: {all}")),
        // Those that this machine or this build lacks too.
        ("--engine avx51", format!("error: there is no engine `avx51`, did you mean `avx512`?; this build has: {all}")),
        (
            "--engine AVX_512",
            format!("error: there is no engine `AVX_512`, did you mean `avx512`?; this build has: {all}"),
        ),
        (
            "--engine papper",
            format!("error: there is no engine `papper`, did you mean `paper`?; this build has: {all}"),
        ),
        ("--engine atuo", format!("error: there is no engine `atuo`, did you mean `auto`?; this build has: {all}")),
        ("--engine x", format!("error: there is no engine `x`; this build has: {all}")),
    ] {
        place.refuses(&format!("render scene.in {arguments}"), 2, &message);
    }
    for engine in Engine::ALL.iter().filter(|engine| ["reference", "rust", "c", "paper"].contains(&engine.name())) {
        let (lacks, has) = if *engine == Engine::Reference { ("single", "double") } else { ("double", "single") };
        let message = format!("error: the engine `{engine}` does not compute in {lacks}; it has: {has}");
        place.refuses(&format!("render scene.in --engine {engine} --precision {lacks}"), 2, &message);
    }
    let half = place.run("render scene.in --precision half");
    assert_eq!((half.status, half.stdout.as_str()), (2, ""));
    let list = "error: there is no precision `half`; there are: single, ";
    assert!(half.stderr.starts_with(list) && half.stderr.contains("double"), "{}", half.stderr);
    assert_eq!(place.files(), ["scene.in"]);
}

#[test]
fn the_environment_names_an_engine_and_an_option_overrides_it() {
    let mut place = Place::new();
    place.variables.push(("RAYO_ENGINE", "reference"));
    assert!(place.run("render scene.in").stderr.contains(" by reference, "));
    assert!(place.run("render scene.in --force --engine rust").stderr.contains(" by rust, "));
    assert!(place.run("plan scene.in").stdout.contains(" by reference in double, "));
    // Where a name comes from is told, since it is not in sight.
    place.variables = vec![("RAYO_ENGINE", "nope")];
    let message = format!("there is no engine `nope`; this build has: {}", engines(|_| true));
    for command in ["render", "plan"] {
        place.refuses(&format!("{command} scene.in"), 2, &format!("error: RAYO_ENGINE: {message}"));
    }
    assert_eq!(place.run("plan scene.in --engine rust").status, 0);
    #[cfg(unix)]
    {
        let run = place.shell("RAYO_ENGINE=$(printf 'a\\377') rayo plan scene.in");
        let told = format!("error: RAYO_ENGINE: {}\n", message.replace("nope", "a\u{fffd}"));
        assert_eq!((run.status.code(), String::from_utf8_lossy(&run.stderr).as_ref()), (Some(2), told.as_str()));
    }
    place.variables = vec![("RAYO_ENGINE", "")];
    assert_eq!(place.run("plan scene.in").status, 0);
    place.variables.clear();
    place.refuses("plan scene.in --engine=", 2, &format!("error: {}", message.replace("nope", "")));
    place.refuses("plan scene.in --engine nix", 2, &format!("error: {}", message.replace("nope", "nix")));
}

#[test]
fn unusable_engine_is_refused_alike_by_every_command() {
    let (place, list) = (Place::new(), engines(|engine| engine.usable()));
    for engine in Engine::ALL.iter().filter(|engine| !engine.usable()) {
        let message = format!("error: this CPU does not run the engine `{engine}`; it runs: {list}");
        for command in [
            "render scene.in --engine",
            "plan scene.in --engine",
            "step scene.in --engine",
            "step --op dot --a 1,2,3 --b 1,2,3 --engine",
            "stability --engine",
            "experiment --engines",
        ] {
            place.refuses(&format!("{command} {engine}"), 2, &message);
        }
    }
}

#[test]
fn what_only_another_build_has_is_refused_as_such() {
    let place = Place::new();
    let list = engines(|_| true);
    let message = |engine| format!("error: there is no engine `{engine}` in this build; this build has: {list}");
    let mut lacking = Vec::new();
    for (engine, built) in [("c", cfg!(feature = "c")), ("paper", cfg!(all(feature = "asm", target_arch = "x86_64")))] {
        assert_eq!(list.split(", ").any(|name| name == engine), built, "{engine}: {list}");
        if !built {
            place.refuses(&format!("render scene.in --engine {engine}"), 2, &message(engine));
            lacking.push(engine);
        }
    }
    // It needs both.
    if let Some(engine) = lacking.first() {
        place.refuses("experiment", 2, &message(engine));
    }
    if !cfg!(all(feature = "asm", target_arch = "x86_64")) {
        for (command, what) in [("ops", "count"), ("step scene.in", "watch"), ("report", "report on")] {
            let why = "it was built without the feature `asm`, or not for x86-64";
            place.refuses(command, 2, &format!("error: this build has no kernels in assembly to {what}: {why}"));
        }
    }
    let info = place.run("info").stdout;
    assert_eq!(
        info.contains("NASM         none (built without assembly)\n"),
        !cfg!(all(feature = "asm", target_arch = "x86_64")),
        "{info}"
    );
    assert_eq!(info.contains("C compiler   none (built without C)\n"), !cfg!(feature = "c"), "{info}");
}

#[test]
fn every_engine_renders_from_the_command_line() {
    let place = Place::new();
    let usable: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).collect();
    for engine in &usable {
        let run = place.run(&format!("render scene.in --engine {engine} -o {engine}.png"));
        let start = format!("{engine}.png: 16x12 by {engine}, traced in ");
        assert!(run.summary().starts_with(&start), "{}", run.summary());
        let diff = place.run(&format!("diff reference.png {engine}.png --tolerance 1"));
        assert_eq!(diff.status, 0, "{engine}: {}", diff.stdout);
    }
    let auto = place.run("render scene.in -o auto.png");
    assert!(auto.summary().contains(&format!(" by {}, ", Engine::fastest())), "{}", auto.summary());
    assert_eq!(place.files().len(), usable.len() + 2);
}
