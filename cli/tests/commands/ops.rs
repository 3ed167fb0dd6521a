//! Instruction counts: the counters applied to functions with known counts, and `rayo ops` itself.

mod executed {
    use rayo::internals::kernels::harness::KNOWN;
    use rayo::internals::kernels::step::{
        Unavailable, count_function, count_instructions, record, record_kernels, visits as visits_of,
    };

    #[test]
    fn single_stepping_counts_known_functions_exactly() {
        for known in KNOWN {
            let visits = count_function(known.address(), 1 << 14, || {
                known.call();
                known.call();
            })
            .unwrap();
            let once = known.executed + 2; // endbr64, ret
            assert_eq!(visits.calls, 2, "{}", known.symbol);
            assert_eq!(visits.at.iter().sum::<u64>(), 2 * once, "{}", known.symbol);
            assert_eq!(visits.instructions, 2 * (once + known.elsewhere), "{}", known.symbol);
        }
    }

    #[test]
    fn a_loop_is_counted_by_its_trips_at_each_of_its_instructions() {
        let known = KNOWN.iter().find(|known| known.symbol == "rayo_known_loop").unwrap();
        let visits = count_function(known.address(), 64, || known.call()).unwrap();
        let executed: Vec<_> = visits.at.into_iter().filter(|&times| times > 0).collect();
        assert_eq!(executed, [1, 1, 10, 10, 1]); // endbr64, mov, dec, jnz, ret
    }

    #[test]
    fn a_closure_is_counted_with_what_it_calls() {
        let [short, long] = ["rayo_known_7", "rayo_known_1000"]
            .map(|symbol| KNOWN.iter().find(|known| known.symbol == symbol).unwrap())
            .map(|known| count_instructions(|| std::hint::black_box(known).call()).unwrap());
        assert_eq!(long - short, 993);
    }

    #[test]
    fn a_function_that_is_not_called_has_no_visits() {
        let visits = count_function(KNOWN[0].address(), 64, || KNOWN[1].call()).unwrap();
        assert_eq!((visits.calls, visits.instructions), (0, 0));
    }

    #[test]
    fn more_than_memory_holds_is_neither_counted_nor_recorded() {
        let known = &KNOWN[0];
        let counted = count_function(known.address(), 64, || known.call()).unwrap();
        let (code, first) = (known.address()..known.address() + 16, 0..1);
        let (code, first) = (std::slice::from_ref(&code), std::slice::from_ref(&first));
        for many in [1 << 40, usize::MAX] {
            let visits = count_function(known.address(), many, || known.call()).unwrap();
            assert_eq!((visits.calls, visits.instructions), (1, counted.instructions));
            assert_eq!(visits.at[..64], counted.at);
            let refused = Unavailable::Memory { bytes: 0 };
            let is_refused = |error| std::mem::discriminant(&error) == std::mem::discriminant(&refused);
            assert!(visits_of(code, many, || known.call()).is_err_and(is_refused));
            assert!(record(code, first, many, || known.call()).is_err_and(is_refused));
            assert!(record_kernels(code, first, many, || known.call()).is_err_and(is_refused));
        }
    }

    #[test]
    fn threads_that_count_at_once_do_not_disturb() {
        let known = KNOWN.iter().find(|known| known.symbol == "rayo_known_1000").unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..20 {
                        assert_eq!(count_function(known.address(), 0, || known.call()).unwrap().instructions, 1002);
                    }
                });
            }
        });
    }

    #[test]
    fn what_starts_a_thread_or_a_process_lives_and_is_not_counted() {
        let thread: fn() = || std::thread::spawn(|| ()).join().unwrap();
        let process: fn() = || assert!(std::process::Command::new("true").status().unwrap().success());
        for start in [thread, process] {
            assert_eq!(count_instructions(start), Err(Unavailable::Lost));
        }
        assert!(count_instructions(|| ()).unwrap() > 0);
    }

    #[test]
    fn what_calls_kernels_is_not_stepped_and_may_start_threads() {
        let known = KNOWN.iter().find(|known| known.symbol == "rayo_known_7").unwrap();
        let code = known.address()..known.address() + 64;
        let code = std::slice::from_ref(&code);
        let action = || {
            std::thread::spawn(|| ()).join().unwrap();
            known.call();
            known.call();
        };
        let once = known.executed as usize + 2; // endbr64, ret
        let all = visits_of(code, 100, action).unwrap();
        assert_eq!((all.visits.len(), all.complete), (2 * once, true));
        assert_eq!(all.visits[0].rip, known.address() as u64);
        let first = visits_of(code, once + 1, action).unwrap();
        assert_eq!((first.visits.len(), first.complete), (once + 1, false));
        let wanted = 0..u64::MAX;
        let recording = record_kernels(code, std::slice::from_ref(&wanted), 100, action).unwrap();
        assert_eq!((recording.executed, recording.steps().count()), (2 * once as u64, 2 * once));
        let panic = std::panic::catch_unwind(|| visits_of(code, 100, || panic!("on purpose"))).unwrap_err();
        assert_eq!(panic.downcast_ref::<&str>(), Some(&"on purpose"));
        known.call();
        assert_eq!(visits_of(code, 100, || known.call()).unwrap().visits.len(), once);
    }

    #[test]
    fn a_panic_in_what_is_counted_comes_out_and_counting_goes_on() {
        let panic = std::panic::catch_unwind(|| count_instructions(|| panic!("on purpose"))).unwrap_err();
        assert_eq!(panic.downcast_ref::<&str>(), Some(&"on purpose"));
        assert!(count_instructions(|| ()).unwrap() > 0);
    }
}

mod disassembled {
    use rayo::internals::kernels::harness::KNOWN;
    use rayo_lab::measure::instructions::{Class, Code, Width, decode};

    #[test]
    fn disassembly_counts_known_functions_exactly() {
        for known in KNOWN {
            let code = Code::of_symbol(known.symbol).unwrap();
            assert_eq!(code.body().unwrap().instructions as u64, known.body, "{}", known.symbol);
            assert_eq!(code.function().instructions as u64, known.body + 2, "{}", known.symbol); // endbr64, ret
        }
    }

    #[test]
    fn code_read_from_the_process_is_that_of_its_object() {
        for known in KNOWN {
            let (object, process) =
                (Code::of_symbol(known.symbol).unwrap(), Code::of_function(known.symbol, known.address()).unwrap());
            assert_eq!(process.function(), object.function(), "{}", known.symbol);
        }
    }

    #[test]
    fn unknown_address_or_symbol_gives_nothing() {
        static DATA: [u8; 4] = [0xc3; 4];
        assert!(Code::of_function("data", DATA.as_ptr() as usize).is_none());
        assert!(Code::of_function("null", 0).is_none());
        assert!(Code::of_symbol("rayo_no_such_symbol").is_none());
        assert!(Code::in_object(b"not an object", "rayo_known_0").is_none());
    }

    /// The machine code of an instruction, and its classification.
    const KINDS: [(&[u8], &str, Class, Width, bool); 24] = [
        (&[0x0f, 0x58, 0xc1], "addps xmm0, xmm1", Class::Arithmetic, Width::Packed, false),
        (&[0xf3, 0x0f, 0x58, 0xc1], "addss xmm0, xmm1", Class::Arithmetic, Width::Scalar, false),
        (&[0x0f, 0x58, 0x06], "addps xmm0, [rsi]", Class::Arithmetic, Width::Packed, true),
        (&[0xf2, 0x0f, 0x7c, 0xc0], "haddps xmm0, xmm0", Class::Arithmetic, Width::Packed, false),
        (&[0x0f, 0x2f, 0xc1], "comiss xmm0, xmm1", Class::Arithmetic, Width::Scalar, false),
        (&[0xf3, 0x0f, 0x51, 0xc0], "sqrtss xmm0, xmm0", Class::Arithmetic, Width::Scalar, false),
        (&[0xf3, 0x48, 0x0f, 0x2a, 0xc2], "cvtsi2ss xmm0, rdx", Class::Arithmetic, Width::Scalar, false),
        (&[0x0f, 0xc6, 0xc0, 0x00], "shufps xmm0, xmm0, 0", Class::Shuffle, Width::Packed, false),
        (&[0x66, 0x0f, 0x70, 0xc0, 0xc9], "pshufd xmm0, xmm0, 0C9h", Class::Shuffle, Width::Packed, false),
        (&[0xf3, 0x0f, 0x16, 0xc8], "movshdup xmm1, xmm0", Class::Shuffle, Width::Packed, false),
        (&[0x0f, 0x12, 0xc1], "movhlps xmm0, xmm1", Class::Shuffle, Width::Packed, false),
        (&[0x0f, 0x28, 0x06], "movaps xmm0, [rsi]", Class::Load, Width::Packed, true),
        (&[0xf3, 0x0f, 0x10, 0x0a], "movss xmm1, [rdx]", Class::Load, Width::Scalar, true),
        (&[0x0f, 0x29, 0x07], "movaps [rdi], xmm0", Class::Store, Width::Packed, false),
        (&[0x0f, 0x28, 0xc1], "movaps xmm0, xmm1", Class::Move, Width::Packed, false),
        (&[0x48, 0x8b, 0x06], "mov rax, [rsi]", Class::Load, Width::General, true),
        (&[0x55], "push rbp", Class::Store, Width::General, false),
        (&[0xc3], "ret", Class::Branch, Width::General, true),
        (&[0xf3, 0x0f, 0x1e, 0xfa], "endbr64", Class::Other, Width::General, false),
        (&[0x48, 0x8d, 0x04, 0x40], "lea rax, [rax+rax*2]", Class::Arithmetic, Width::General, false),
        (&[0xc5, 0xfc, 0x58, 0xc1], "vaddps ymm0, ymm0, ymm1", Class::Arithmetic, Width::Packed, false),
        (&[0xc4, 0xe2, 0x7d, 0x18, 0x06], "vbroadcastss ymm0, [rsi]", Class::Load, Width::Packed, true),
        (&[0xc5, 0xf8, 0x77], "vzeroupper", Class::Other, Width::General, false),
        (&[0x62, 0xf1, 0x7c, 0x48, 0x58, 0xc1], "vaddps zmm0, zmm0, zmm1", Class::Arithmetic, Width::Packed, false),
    ];

    #[test]
    fn instructions_are_told_by_their_kind() {
        for (bytes, text, class, width, reads) in KINDS {
            let instructions: Vec<_> = decode(bytes, 0).collect();
            let [i] = &instructions[..] else { panic!("{text}: {instructions:?}") };
            assert_eq!(
                (&*i.text, i.class, i.width, i.reads, i.bytes),
                (text, class, width, reads, bytes.len()),
                "{text}"
            );
        }
        let wide: Vec<_> = decode(KINDS[23].0, 0).collect();
        assert_eq!(wide[0].features, ["AVX512F"]);
    }
}

mod table {
    use crate::extent;
    use rayo_lab::experiments::ops::{self, OPS, Options, Report};

    fn count(op: Option<&str>, executed: bool) -> Report {
        ops::run(
            &Options { wanted: op.map(str::to_owned).into_iter().collect(), executed, ..Options::default() },
            &mut |_, _| (),
        )
        .unwrap()
    }

    #[test]
    fn macros_of_the_paper_have_the_papers_counts() {
        let report = count(None, false);
        for op in &OPS[..6] {
            let body = |name| report.rows.iter().find(|r| r.op == *op && r.implementation == name).unwrap().body;
            assert!(body("paper").is_some());
            assert_eq!(body("paper"), body("printed-simd"), "{op}");
        }
    }

    #[test]
    fn an_operation_without_a_form_on_packets_has_rows() {
        let report = count(Some("lambert2"), false);
        let body = |name| report.rows.iter().find(|row| row.implementation == name).unwrap().body;
        assert!(body("paper").is_some() && body("aos").is_some());
        assert_eq!((body("avx2"), body("c-O3")), (None, None));
    }

    #[test]
    fn listing_has_every_instruction_with_its_executions() {
        let report = count(Some("dot"), true);
        // Unoptimised Rust code consists of calls of other functions, whose instructions the
        // listing lacks.
        let is_whole = |name: &str| !cfg!(debug_assertions) || !["rust", "glam"].contains(&name);
        for row in report.rows.iter().filter(|row| row.executed.is_some() && is_whole(&row.implementation)) {
            assert_eq!(row.listing.len(), row.function.unwrap(), "{}", row.implementation);
            assert!(row.listing.iter().all(|line| line.executed == Some(1)), "{}", row.implementation);
            assert_eq!(row.listing.iter().filter(|line| line.body).count(), row.body.unwrap_or(0));
            assert!(row.listing.last().unwrap().text.ends_with("ret"), "{}", row.implementation);
        }
    }

    #[test]
    fn instructions_of_a_picture_are_the_same_each_time() {
        if !extent::all() {
            return; // a quarter of a minute
        }
        let (one, two) = (count(None, true).frames, count(None, true).frames);
        assert!(one.len() >= 2);
        for (one, two) in one.iter().zip(&two) {
            assert_eq!(one.engine, two.engine);
            // What the allocator does depends on earlier allocations.
            if ["reference", "rust", "c", "paper"].contains(&&*one.engine) {
                assert_eq!(one.instructions, two.instructions, "{}", one.engine);
            }
            assert!(one.per_pixel >= 1.0);
        }
    }

    #[test]
    fn costs_are_there_and_positive_where_something_runs() {
        let options = Options { wanted: vec!["norm".into()], cost: true, ..Options::default() };
        let report = ops::run(&options, &mut |_, _| ()).unwrap();
        assert!(report.core_cycles_per_tick.is_some_and(|cycles| cycles > 0.0));
        for row in report.rows {
            let costs = [row.call_latency, row.call_throughput, row.throughput];
            let runs =
                !row.implementation.starts_with("printed") && row.function.is_some() && row.unavailable.is_none();
            // If other processes occupy the core, a measurement may be implausible, which is then
            // reported as none.
            let known =
                |cost: &Option<f64>| if runs { cost.is_some_and(|cycles| cycles >= 0.5) } else { cost.is_none() };
            assert!(costs.iter().all(known) || row.no_cycles.is_some(), "{}", row.implementation);
            let body = ["paper", "aos", "sse41", "avx2", "avx512"].contains(&&*row.implementation);
            assert_eq!(
                row.cost_of.as_deref(),
                runs.then_some(if body { "body" } else { "call" }),
                "{}",
                row.implementation
            );
        }
    }
}

mod by_value {
    use rayo::internals::kernels::{
        self, Light, OpRef, PaperSphere, PaperTriangle, Plain, Ray, Surface, Vec4, by_value,
    };
    use rayo::internals::scene::Rng;

    /// The same functions with arguments by address, compiled for the engine.
    fn same(level: &str, rng: &mut Rng) {
        let Some(f) = by_value(level) else { return };
        let vector = |rng: &mut Rng| Vec4::new(rng.between(-2.0, 2.0), rng.between(-2.0, 2.0), rng.between(0.5, 4.0));
        let (a, b, c, d) = (vector(rng), vector(rng), vector(rng), vector(rng));
        // Levels that may fuse multiplications and additions round differently.
        let close = |x: f32, y: f32| x == y || (x - y).abs() <= 1e-4 * (x.abs() + y.abs() + 1.0);
        let close4 = |x: Vec4, y: Vec4| x.lanes().iter().zip(y.lanes()).all(|(x, y)| close(*x, y));
        let sphere = PaperSphere { centre: b, colour: c, radius: 0.5, padding: [0.0; 3] };
        let triangle = PaperTriangle { v1: b, v2: c, v3: d, colour: c };
        let (surface, light) = (Surface { point: a, normal: b, colour: c }, Light { position: d, radiance: c });
        let ray = Ray { origin: Vec4::ZERO, direction: a };
        let hit = |(hit, t): (bool, f32)| if hit { t } else { f32::INFINITY };
        for (name, op) in kernels::c().unwrap().ops() {
            let agree = match (name, op) {
                ("add", OpRef::Vector(op)) => close4(op.call(&a, &b), f.add(a, b)),
                ("sub", OpRef::Vector(op)) => close4(op.call(&a, &b), f.sub(a, b)),
                ("scale", OpRef::Scale(op)) => close4(op.call(&a, &b.x), f.scale(a, b.x)),
                ("dot", OpRef::Scalar(op)) => close(op.call(&a, &b), f.dot(a, b)),
                ("norm", OpRef::Scalar(op)) => close(op.call(&a, &b), f.norm(a)),
                ("cross", OpRef::Vector(op)) => close4(op.call(&a, &b), f.cross(a, b)),
                ("normalise", OpRef::Vector(op)) => close4(op.call(&a, &b), f.normalise(a)),
                ("sphere", OpRef::Sphere(op)) => {
                    let mut t = 0.0;
                    let found = f.sphere(ray, &sphere, &mut t);
                    close(op.call(&a, &sphere), hit((found, t)))
                }
                ("triangle", OpRef::Triangle(op)) => {
                    let mut t = 0.0;
                    let found = f.triangle(ray, &triangle, &mut t);
                    close(op.call(&a, &triangle), hit((found, t)))
                }
                ("lambert", OpRef::Lambert(op)) => close4(op.call(&surface, &light), f.lambert(&light, a, b, c, false)),
                ("lambert2", OpRef::Lambert(op)) => close4(op.call(&surface, &light), f.lambert(&light, a, b, c, true)),
                _ => panic!("{name} is not compared"),
            };
            assert!(agree, "{level} {name}: {a:?} {b:?} {c:?} {d:?}");
        }
    }

    #[test]
    fn the_c_that_is_counted_computes_what_the_engines_c_computes() {
        for level in ["O0", "O1", "O2", "O3", "native"] {
            let mut rng = Rng::new(7);
            for _ in 0..200 {
                same(level, &mut rng);
            }
        }
        assert!(by_value("O0").is_some());
        assert!(by_value("O7").is_none());
    }
}

mod command {
    use std::collections::BTreeSet;
    use std::fs;
    use std::path::Path;
    use std::process::Command;
    use std::sync::OnceLock;

    use crate::extent;
    use crate::program::{Run, rayo};
    use crate::schema;
    use serde_json::Value;

    fn run(args: &[&str]) -> Run {
        rayo([&["ops"], args].concat(), Path::new("."))
    }

    /// The printed text.
    fn text(args: &[&str]) -> String {
        run(args).printed().to_owned()
    }

    /// The cells in the column of the first table with this heading.
    fn column<'a>(text: &'a str, head: &str) -> Vec<&'a str> {
        let cells = |line: &'a str| line.split('|').map(str::trim).collect::<Vec<_>>();
        let mut rows = text.lines().take_while(|line| line.starts_with('|')).map(cells);
        let heads = rows.next().unwrap_or_default();
        let at = heads.iter().position(|cell| *cell == head).unwrap_or_else(|| panic!("no column `{head}`: {text}"));
        rows.skip(1).map(|cells| cells[at]).collect()
    }

    /// A run that another program starts, with these options.
    fn under(program: &str, options: &[&str], args: &[&str]) -> Run {
        let ops = [env!("CARGO_BIN_EXE_rayo"), "ops", "--op", "add", "--engine", "paper", "--executed"];
        Run::of(Command::new(program).args([options, &ops, args].concat()).output().unwrap())
    }

    #[test]
    fn the_document_has_the_fields_that_the_design_names() {
        let document = run(&["--op", "dot", "--executed", "--json"]).document();
        assert_eq!(document["schema"], 1);
        let rows = document["rows"].as_array().unwrap();
        assert_eq!(rows.len(), 14);
        for row in rows {
            let row = row.as_object().unwrap();
            for field in ["op", "implementation", "body", "function", "per_vector", "executed", "latency", "throughput"]
            {
                assert!(row.contains_key(field), "{field}");
            }
        }
        let paper = rows.iter().find(|row| row["implementation"] == "paper").unwrap();
        assert_eq!((&paper["body"], &paper["function"], &paper["executed"]), (&3.into(), &8.into(), &8.into()));
        assert_eq!(paper["critical_path"], "mul -> hadd -> hadd");
        let printed = rows.iter().find(|row| row["implementation"] == "printed-c").unwrap();
        assert_eq!((&printed["function"], &printed["latency"]), (&25.into(), &Value::Null));
    }

    #[test]
    fn counts_survive_strip_and_another_place() {
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("elsewhere");
        fs::copy(env!("CARGO_BIN_EXE_rayo"), &copy).unwrap();
        if !Command::new("strip").arg(&copy).status().is_ok_and(|status| status.success()) {
            extent::not_run("strip", "counts survive strip");
        }
        let counts = |document: Value| {
            let rows = document["rows"].as_array().unwrap().iter();
            rows.map(|row| ["implementation", "body", "function", "executed"].map(|name| row[name].clone()))
                .collect::<Vec<_>>()
        };
        let args = ["--op", "cross", "--executed", "--json"];
        let by_copy = Run::of(Command::new(&copy).arg("ops").args(args).output().unwrap());
        assert_eq!(counts(by_copy.document()), counts(run(&args).document()));
    }

    #[test]
    fn the_listing_marks_the_body_and_what_differs() {
        let listing = text(&["--op", "dot", "--engine", "paper,aos", "--asm"]);
        assert!(listing.contains(" |haddps xmm0, xmm0"), "{listing}");
        assert!(listing.contains("*|movhlps xmm0, xmm0"), "{listing}");
        assert!(listing.contains("  movaps xmm0, [rsi]"), "{listing}");
        assert!(!listing.contains("c-O0"), "{listing}");
    }

    #[test]
    fn every_kernel_of_the_engines_is_listed_and_can_be_asked_for() {
        let listed = text(&["--kernels"]);
        let symbols: BTreeSet<_> = listed.lines().filter_map(|line| line.split(' ').next()).collect();
        for symbol in rayo::internals::kernels::packet_symbols().into_iter().chain(["rayo_paper_trace", "rayo_c_trace"])
        {
            assert!(symbols.contains(symbol), "{symbol}");
        }
        let document = run(&["--kernels", "--json"]).document();
        assert_eq!(document["kernels"].as_array().unwrap().len(), listed.lines().count());
        let nearest = "no kernel `rayo_papr_trace`; the nearest are rayo_paper_trace";
        run(&["--kernel", "rayo_papr_trace"]).refuses(nearest);
    }

    #[test]
    fn listing_of_a_kernel_has_labels_and_source_lines() {
        if rayo::internals::kernels::paper().is_none() {
            return;
        }
        let symbol = "rayo_paper_trace";
        let document = run(&["--kernel", symbol, "--json"]).document();
        let kernel = &document["kernels"][0];
        let lines = kernel["listing"].as_array().unwrap();
        assert_eq!(
            (kernel["symbol"].as_str(), kernel["instructions"].as_u64()),
            (Some(symbol), Some(lines.len() as u64))
        );
        let source = |line: &Value| line["source"].clone();
        let dot = lines.iter().find(|line| {
            source(line)["macros"].as_array().is_some_and(|macros| macros.iter().any(|name| name == "VEC_DOT"))
        });
        let dot = source(dot.expect("it has a dot product"));
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(dot["file"].as_str().unwrap());
        let file = fs::read_to_string(path).unwrap();
        let line = file.lines().nth(dot["line"].as_u64().unwrap() as usize - 1).unwrap();
        assert!(line.contains(dot["text"].as_str().unwrap().split(' ').next().unwrap()), "{line}: {dot}");

        let listing = text(&["--kernel", symbol]);
        let jumps = lines.iter().filter(|line| line["target"].is_u64()).count();
        assert!(jumps > 3);
        let named: Vec<_> = listing.lines().filter_map(|line| line.split_once(" .")?.1.split(' ').next()).collect();
        assert_eq!(named.len(), jumps, "{listing}");
        for label in named {
            assert!(listing.lines().any(|line| line.starts_with(&format!(".{label}:"))), "{label}: {listing}");
        }
        assert!(listing.contains("  VEC_DOT < SPHERE_HIT"), "{listing}");
        assert!(!listing.contains('\u{1b}'), "no colours in a pipe");
    }

    #[test]
    fn a_constant_is_named_where_a_kernel_reads_it() {
        let listing = text(&["--kernel", "rayo_paper_sphere"]);
        assert!(listing.lines().any(|line| line.contains("movss xmm1, [") && !line.contains("h]")), "{listing}");
    }

    #[test]
    fn equal_critical_paths_share_a_line() {
        let table = text(&["--op", "add,sub,dot", "--engine", "paper,aos,avx2"]);
        let rows = table.lines().filter(|line| line.contains(" | paper body "));
        let ops: Vec<_> = rows.map(|line| &line[..6]).collect();
        assert_eq!(ops, ["| add ", "| sub ", "| dot "], "{table}");
        let paths: Vec<_> = table.lines().skip_while(|line| *line != "Critical paths").skip(1).take(4).collect();
        assert!(paths.iter().any(|line| line.trim() == "of one operation: add, sub"), "{table}");
        assert!(paths[0].contains("mul -> "), "{table}");
    }

    #[test]
    fn unknown_names_are_bad_usage_with_a_list() {
        for (args, expected) in [
            (["--op", "divide"], "no operation `divide`; there are: add, sub, scale"),
            (["--op", "norm,dost"], "there is no operation `dost`; there are: add, "),
            (["--engine", "gpu"], "no implementation `gpu` of single operations; there are: printed-c"),
        ] {
            run(&args).refuses(expected);
        }
    }

    #[test]
    fn executed_counts_without_the_trap_flag_are_refused() {
        if Command::new("valgrind").arg("--version").output().is_err() {
            return extent::not_run("valgrind", "what is said without the trap flag");
        }
        let table = under("valgrind", &["-q"], &[]).printed().to_owned();
        let executed = column(&table, "executed");
        assert_eq!(executed, ["n/a"], "{table}");
        assert!(table.contains("the trap flag has no effect here"), "{table}");
        let document = under("valgrind", &["-q"], &["--json"]).document();
        assert_eq!(document["rows"][0]["executed"], Value::Null);
        assert_eq!(document["rows"][0]["function"], 6);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_tables_fit_a_terminal_of_80_columns() {
        let ops = format!("stty rows 24 cols 80; '{}' ops --op dot,triangle", env!("CARGO_BIN_EXE_rayo"));
        for arguments in ["", " --asm"] {
            let mut script = Command::new("script");
            script.args(["-qec", &format!("{ops}{arguments}"), "/dev/null"]).stdin(std::process::Stdio::null());
            let shown = Run::of(script.output().unwrap()).stdout;
            // Text that a progress bar has overwritten is not visible.
            let lines: Vec<_> =
                shown.lines().filter_map(|line| line.trim_end_matches('\r').rsplit('\r').next()).collect();
            assert!(lines.iter().any(|line| line.contains("aos")), "{shown}");
            for line in lines.iter().filter(|line| !line.contains('\u{1b}')) {
                assert!(line.chars().count() <= 80, "{line}");
            }
        }
    }

    #[test]
    fn executed_counts_under_a_debugger_are_refused_with_why() {
        if Command::new("strace").arg("--version").output().is_err() {
            return extent::not_run("strace", "what is said under a debugger");
        }
        let run = under("strace", &["-o", "/dev/null"], &[]);
        assert!(run.printed().contains("traces this one"), "{}", run.stdout);
    }

    /// The part of a document from a line that begins with `start` to the end of the part,
    /// including that line.
    fn part<'a>(document: &'a str, start: &str) -> &'a str {
        let from = document.find(start).unwrap_or_else(|| panic!("there is no `{start}`"));
        let length = document[from..].find("<!-- end -->").expect("the part has an end");
        &document[from..from + length]
    }

    /// The output that the document in docs shows, printed once.
    fn as_in_docs() -> &'static str {
        static PRINTED: OnceLock<String> = OnceLock::new();
        PRINTED.get_or_init(|| text(&["--executed", "--markdown"]))
    }

    #[test]
    fn proofs_keep_to_their_schema_and_none_fails() {
        let schema = serde_json::from_str(include_str!("../../../docs/proofs.schema.json")).unwrap();
        let document = run(&["--proofs", "--json"]).document();
        assert_eq!(schema::errors(&schema, &document), Vec::<String>::new());
        let of = |list: &str| document[list].as_array().unwrap().clone();
        assert!(
            of("macros")
                .iter()
                .all(|row| row["verdict"] != "failed" && row["reason"].is_null() == (row["verdict"] == "proved"))
        );
        assert!(of("bounds").iter().all(|bound| bound["holds"] == true));
    }

    #[test]
    fn the_table_of_proofs_in_docs_is_what_the_command_prints() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("docs/results/proofs.txt");
        let stale = "docs/results/proofs.txt is stale: run `rayo ops --proofs > docs/results/proofs.txt`";
        assert_eq!(fs::read_to_string(path).unwrap(), text(&["--proofs"]), "{stale}");
    }

    #[test]
    fn the_document_in_docs_is_what_the_command_prints() {
        if cfg!(debug_assertions) {
            // Its jumps have the long encoding (see build.rs).
            return extent::not_run("an optimised build", "the document of instruction counts is current");
        }
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("docs/results/instruction-counts.md");
        let kept = fs::read_to_string(path).unwrap();
        let made = as_in_docs();
        assert!(made.contains(&rayo_lab::measure::cpu_name()));
        let stale = "is stale: run `rayo ops --executed --markdown > docs/results/instruction-counts.md`";
        assert_eq!(part(&kept, "<!-- assembled"), part(made, "<!-- assembled"), "the assembled part {stale}");
        // Other compilers generate other code. c-native depends on the CPU, and Rust's code on the
        // profile and the test.
        let (kept, made) = (part(&kept, "<!-- compiled"), part(made, "<!-- compiled"));
        if kept.lines().next() == made.lines().next() {
            let fixed = |part: &str| {
                let cells = |line: &str| line.split('|').take(7).collect::<Vec<_>>().join("|");
                part.lines().map(cells).collect::<Vec<_>>()
            };
            assert_eq!(fixed(kept), fixed(made), "the compiled part {stale}");
        }
    }

    /// The tables under a heading, up to the next heading: for each its rows, and for each row its
    /// cells with the columns' names.
    fn tables<'a>(document: &'a str, heading: &str) -> Vec<Vec<Vec<(&'a str, &'a str)>>> {
        let section = document.split(heading).nth(1).unwrap_or_else(|| panic!("there is no `{heading}`"));
        let section = section.split("\n## ").next().unwrap();
        let cells = |line: &'a str| line.trim_matches('|').split('|').map(str::trim).collect::<Vec<_>>();
        let table = |table: &'a str| {
            let mut lines = table.lines().filter(|line| line.starts_with('|'));
            let names = cells(lines.next()?);
            Some(lines.skip(1).map(|line| names.iter().copied().zip(cells(line)).collect()).collect())
        };
        section.split("\n\n").filter_map(table).collect()
    }

    #[test]
    fn what_the_document_in_docs_says_is_executed_is_executed() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("docs/results/instruction-counts.md");
        let (kept, made) = (fs::read_to_string(path).unwrap(), as_in_docs());
        let stale = "is stale: run `rayo ops --executed --markdown > docs/results/instruction-counts.md`";
        let [kept_tables, made_tables] = [&kept, made].map(|document| tables(document, "## Executed"));
        let ([kept_ops, kept_frames], [made_ops, made_frames]) = (&kept_tables[..], &made_tables[..]) else {
            panic!("two tables, of operations and of pictures: {made_tables:?}");
        };
        // Code that this CPU runs and that no compiler generated.
        let fixed = |name: &str| ["paper", "aos", "sse41", "avx2", "avx512"].contains(&name);
        let mut compared = 0;
        assert_eq!(kept_ops.len(), made_ops.len(), "the executed part {stale}");
        for (kept, made) in kept_ops.iter().zip(made_ops) {
            let op = made[0].1;
            assert_eq!(kept[0].1, op, "the executed part {stale}");
            for (name, count) in made.iter().filter(|(name, _)| fixed(name)) {
                let kept = kept.iter().find(|(other, _)| other == name);
                assert_eq!(kept, Some(&(*name, *count)), "{op} by {name} {stale}");
                compared += 1;
            }
        }
        assert!(compared >= 20 * 3, "{compared}");
        // Besides kernels these pictures execute Rust code and the allocator, which is negligible
        // per pixel if it is optimised.
        if cfg!(debug_assertions) {
            return;
        }
        for made in made_frames.iter().filter(|made| ["paper", "sse41", "avx2", "avx512"].contains(&made[0].1)) {
            let kept = kept_frames.iter().find(|kept| kept[0] == made[0]).unwrap_or_else(|| panic!("{made:?} {stale}"));
            let [kept, now] = [kept, made].map(|row| row.last().unwrap().1.parse::<f64>().unwrap());
            assert!((kept - now).abs() < 0.25, "{made:?}, {kept} instructions a pixel {stale}");
        }
    }
}
