//! Scene files in the paper's format: what is read, the errors for invalid files, and the memory
//! that both take.

use std::fs;
use std::path::{Path, PathBuf};

use crate::counting::peak_of;
use glam::Vec3;
use rayo::internals::scene::{Camera, Light, MAX_PIXELS, Rng, Scene, SceneError, Sphere, Triangle, many, parse, read};

/// The bytes that diagnostics may take, however short the file is.
const SLACK: usize = 64 << 10;

/// Parses a file and checks that this takes at most 16 times its length in memory.
fn parse_bounded(source: &[u8]) -> Result<Scene, SceneError> {
    let (scene, peak) = peak_of(|| parse(source, "test.in"));
    assert!(peak <= 16 * source.len() + SLACK, "{peak} bytes for a file of {}", source.len());
    scene
}

/// The errors, one line for each diagnostic.
fn refused(source: impl AsRef<[u8]>) -> Vec<String> {
    parse_bounded(source.as_ref()).expect_err("a refusal").lines()
}

fn accepted(source: impl AsRef<[u8]>) -> Scene {
    parse_bounded(source.as_ref()).unwrap_or_else(|error| panic!("refused:\n{error}"))
}

fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "in"));
    files.sort();
    files
}

/// A scene with everything that the format has, one item per line.
const VALID: &str = "\
image.png
640 480
1
1
0.5  1 0.25 0  20 -20 0
2
30  1 1 1  0 0 120
2.5  0 0.5 1  -1e1 .5 +7
1
1 0 0  0 0 1  1 0 1  0 1 1
";

#[test]
fn every_number_of_a_file_lands_in_its_place() {
    let expected = Scene {
        name: "image.png".to_owned(),
        lights: vec![Light {
            intensity: 0.5,
            colour: Vec3::new(1.0, 0.25, 0.0),
            position: Vec3::new(20.0, -20.0, 0.0),
        }],
        spheres: vec![
            Sphere { radius: 30.0, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, 120.0) },
            Sphere { radius: 2.5, colour: Vec3::new(0.0, 0.5, 1.0), centre: Vec3::new(-10.0, 0.5, 7.0) },
        ],
        triangles: vec![Triangle {
            colour: Vec3::X,
            vertices: [Vec3::Z, Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0)],
        }],
        ..Scene::new(Camera::new(640, 480, 1.0, 1.0).unwrap())
    };
    assert_eq!(accepted(VALID), expected);
}

#[test]
fn a_file_may_be_laid_out_in_any_way() {
    let tokens: Vec<&str> = VALID.split_whitespace().collect();
    let layouts = [
        ("a byte order mark", format!("\u{feff}{VALID}")),
        ("CR LF", VALID.replace('\n', "\r\n")),
        ("CR alone", VALID.replace('\n', "\r")),
        ("tabs, form feeds and vertical tabs", tokens.join("\t\x0c\x0b")),
        ("one line without an end", tokens.join(" ")),
        ("a token in each line", tokens.join("\n\n")),
        ("comments with #", VALID.replace('\n', "# 1 2 3 \u{f1}\n")),
        ("comments with //", VALID.replace('\n', "//1 2 3\n")),
        ("a comment that ends at CR", VALID.replace('\n', " # 1\r")),
        ("comments around it", format!("# a\n// b\n{VALID}# c\n//")),
        ("a comment at the very end", format!("{VALID}# c")),
    ];
    for (layout, source) in layouts {
        assert_eq!(accepted(&source), accepted(VALID), "{layout}");
    }
}

#[test]
fn an_image_name_may_be_a_path_in_any_script() {
    for name in ["out/imagen-1.pgm", "../a.png", "España/図.png", "7", "-", "a\u{a0}b.png"] {
        assert_eq!(accepted(VALID.replace("image.png", name)).name, name);
    }
}

#[test]
fn a_negative_zero_in_a_colour_becomes_zero() {
    let scene = accepted(VALID.replace("0.5  1 0.25 0", "-0.0  -0 -1e-99 -0e9"));
    let Light { intensity, colour, .. } = scene.lights[0];
    assert_eq!([intensity, colour.x, colour.y, colour.z].map(f32::to_bits), [0; 4]);
}

#[test]
fn the_largest_images_are_accepted() {
    for size in ["65535 32768", "1 65535", "32768 65535", "+640 00480"] {
        assert!(accepted(VALID.replace("640 480", size)).camera.pixels() <= MAX_PIXELS, "{size}");
    }
}

#[test]
fn a_bad_value_is_named_with_its_place_and_what_was_expected() {
    const SIDE: &str = "expected a whole number from 1 to 65535";
    // (what is replaced in the valid file, by what, where, what is wrong)
    let cases = [
        ("640 480", "0 480", "2:1", "the width is 0: found `0`, "),
        ("640 480", "640 -480", "2:5", "the height is negative: found `-480`, "),
        ("640 480", "640.0 480", "2:1", "the width is not a whole number: found `640.0`, "),
        ("640 480", "640x480 480", "2:1", "the width is not a whole number: found `640x480`, "),
        ("640 480", "65536 1", "2:1", "the width is too large: found `65536`, "),
        ("640 480", "1 99999999999999999999999", "2:3", "the height is too large: found `99999999999999999999999`, "),
    ];
    for (good, bad, place, message) in cases {
        assert_eq!(refused(VALID.replacen(good, bad, 1)), [format!("test.in:{place}: {message}{SIDE}")]);
    }

    const ANY: &str = "expected a number";
    const AT_LEAST_0: &str = "expected a number of at least 0";
    const ABOVE_0: &str = "expected a number greater than 0";
    let cases = [
        ("\n1\n1\n", "\n0\n1\n", "3:1", "the focal distance is 0: found `0`, ", ABOVE_0),
        ("\n1\n1\n", "\n-1\n1\n", "3:1", "the focal distance is negative: found `-1`, ", ABOVE_0),
        ("\n1\n1\n", "\n1e-50\n1\n", "3:1", "the focal distance rounds to 0: found `1e-50`, ", ABOVE_0),
        ("\n1\n1\n", "\ninfinity\n1\n", "3:1", "the focal distance is infinite: found `infinity`, ", ABOVE_0),
        ("0.5  1", "-0.5  1", "5:1", "light 1's intensity is negative: found `-0.5`, ", AT_LEAST_0),
        ("0.5  1", "0.5  -1", "5:6", "light 1's red is negative: found `-1`, ", AT_LEAST_0),
        ("0.25 0", "-1e-9 0", "5:8", "light 1's green is negative: found `-1e-9`, ", AT_LEAST_0),
        ("0.25 0", "0.25 nan", "5:13", "light 1's blue is not a number: found `nan`, ", AT_LEAST_0),
        ("20 -20 0", "20 -20 -inf", "5:23", "light 1's z is infinite: found `-inf`, ", ANY),
        ("30 ", "-0 ", "7:1", "sphere 1's radius is negative: found `-0`, ", ABOVE_0),
        ("30 ", "0.0e5 ", "7:1", "sphere 1's radius is 0: found `0.0e5`, ", ABOVE_0),
        ("2.5 ", "7e-46 ", "8:1", "sphere 2's radius rounds to 0: found `7e-46`, ", ABOVE_0),
        ("-1e1 .5", "1e39 .5", "8:15", "sphere 2's x is out of range: found `1e39`, ", ANY),
        ("-1e1 .5", "-1e1 0,5", "8:20", "sphere 2's y is not a number: found `0,5`, ", ANY),
        (".5 +7", ".5 0x7", "8:23", "sphere 2's z is not a number: found `0x7`, ", ANY),
        ("1 0 0  0 0 1", "1 0 -1  0 0 1", "10:5", "triangle 1's blue is negative: found `-1`, ", AT_LEAST_0),
        ("1 0 1  0 1 1", "1 0 ñ  0 1 1", "10:19", "triangle 1's z2 is not a number: found `ñ`, ", ANY),
        ("1 0 1  0 1 1", "1 0 1  0 1 1f", "10:26", "triangle 1's z3 is not a number: found `1f`, ", ANY),
        ("1 0 1  0 1 1", "1 0 1  0 1 \x1b[2J", "10:26", "triangle 1's z3 is not a number: found `\\u{1b}[2J`, ", ANY),
    ];
    for (good, bad, place, message, expected) in cases {
        assert_eq!(refused(VALID.replacen(good, bad, 1)), [format!("test.in:{place}: {message}{expected}")]);
    }
}

/// Invalid sources, each followed by its expected errors.
const BAD_FILES: &str = r#"

    1:1: the file is empty: found the end of the file, expected an image name, then the image's width and height
 # a\n\n
    1:1: the file holds no scene: found the end of the file, expected an image name, then the image's width and height
a
    1:2: the width is missing: found the end of the file, expected a whole number from 1 to 65535
a 9 # b\n\n
    1:4: the height is missing: found the end of the file, expected a whole number from 1 to 65535
a 9 9
    1:6: the focal distance is missing: found the end of the file, expected a number greater than 0
a 9 9 1
    1:8: the light count is missing: found the end of the file, expected a whole number: how many lights follow (0 for none)
a 9 9 1 0 0\n
    1:12: the triangle count is missing: found the end of the file, expected a whole number: how many triangles follow (0 for none)
a 9 9 1 -1
    1:9: the light count is negative: found `-1`, expected a whole number: how many lights follow (0 for none)
a 9 9 1 1.0
    1:9: the light count is not a whole number: found `1.0`, expected a whole number: how many lights follow (0 for none)
a 9 9 1 0 two
    1:11: the sphere count is not a whole number: found `two`, expected a whole number: how many spheres follow (0 for none)
a 9 9 1 1 1 1 1 1 0 0
    1:9: the light count is larger than what follows: found `1`, expected at most 0: 6 numbers follow, and a light takes 7
a 9 9 1 0 0 9 1
    1:13: the triangle count is larger than what follows: found `9`, expected at most 0: 1 number follows, and a triangle takes 12
a 9 9 1 0 0 1000000000000000000 1 1
    1:13: the triangle count is larger than what follows: found `1000000000000000000`, expected at most 0: 2 numbers follow, and a triangle takes 12
a 9 9 1 99999999999999999999999999
    1:9: the light count is larger than what follows: found `99999999999999999999999999`, expected at most 0: 0 numbers follow, and a light takes 7
a 9 9 1\n1\n1.5 1.5 1.5 1.5 1.5
    3:20: light 1's y is missing: found the end of the file, expected a number
a 65535 32769 1 0 0 0
    1:9: an image of 65535 x 32769 has more than 2147483648 pixels: found `32769`, expected a height of at most 32768 for that width
a 9 9 1 0 0 0\n 7 8
    2:2: the scene is complete here, and more follows: found `7`, expected the end of the file
"#;

#[test]
fn a_bad_file_is_refused_in_these_words() {
    for case in BAD_FILES[1..].lines().collect::<Vec<_>>().chunks(2) {
        let source = case[0].replace("\\n", "\n").replace("\\r", "\r");
        assert_eq!(refused(&source), [format!("test.in:{}", case[1].trim())], "{source:?}");
    }
    let bytes: [(&[u8], &str); 5] = [
        (b"a 9 9 1\r\n0\r\n0 \xe9", "3:3: byte 14 of the file, 0xe9, is not UTF-8: found `\\xe9`"),
        (b"a 9 9 1 # se\xc3\xb1a\xf1", "1:15: byte 15 of the file, 0xf1, is not UTF-8: found `\\xf1`"),
        (b"\xef\xbb\xbfab\xe9", "1:3: byte 5 of the file, 0xe9, is not UTF-8: found `\\xe9`"),
        (b"\xff\xfea\0", "1:1: byte 0 of the file, 0xff, is not UTF-8: found `\\xff`"),
        (b"a 9 9 1 0 0 \xe2\x82", "1:13: byte 12 of the file, 0xe2, is not UTF-8: found `\\xe2\\x82`"),
    ];
    for (source, place) in bytes {
        assert_eq!(refused(source), [format!("test.in:{place}, expected UTF-8 text")]);
    }
}

#[test]
fn columns_count_characters_and_no_byte_order_mark() {
    assert_eq!(
        refused("\u{feff}ñandú.png 0 480 1 0 0 0"),
        ["test.in:1:11: the width is 0: found `0`, expected a whole number from 1 to 65535"]
    );
}

#[test]
fn several_errors_are_told_in_one_go() {
    let source = VALID.replace("640 480", "640 0").replace("0.25", "x").replace("30 ", "-30 ") + "end";
    assert_eq!(
        refused(source),
        [
            "test.in:2:5: the height is 0: found `0`, expected a whole number from 1 to 65535",
            "test.in:5:8: light 1's green is not a number: found `x`, expected a number of at least 0",
            "test.in:7:1: sphere 1's radius is negative: found `-30`, expected a number greater than 0",
            "test.in:11:1: the scene is complete here, and more follows: found `end`, expected the end of the file",
        ]
    );
}

#[test]
fn beyond_twenty_errors_are_counted() {
    let bad = |count: usize| refused(format!("a 9 9 1 0 {count} {} 0", "-1 1 1 1 1 1 1 ".repeat(count)));
    assert_eq!(bad(20).len(), 20);
    let lines = bad(57);
    assert_eq!(lines.len(), 21);
    assert_eq!(lines[20], "test.in: and 37 more");
}

#[test]
fn an_error_is_shown_with_its_line_and_what_to_do() {
    let source = "room.png\n640 480\n1\n0\n1\n\t-2  1 1 1  0 0 10 # floor\n1\n1 0 0  0 0 1.25  1.25 0 1.25  0\n";
    let error = parse(source.as_bytes(), "scenes/room.in").unwrap_err();
    let expected = "\
error: sphere 1's radius is negative
 --> scenes/room.in:6:2
  |
6 |     -2  1 1 1  0 0 10 # floor
  |     ^^ expected a number greater than 0

error: triangle 1's y3 is missing
 --> scenes/room.in:8:32
  |
8 | 1 0 0  0 0 1.25  1.25 0 1.25  0
  |                                ^ expected a number
  |
  = help: line 7 announces 1 triangle: add what is missing or correct the count";
    assert_eq!(error.render(false), expected);
    assert_eq!(error.to_string(), expected);

    let colour = error.render(true);
    assert!(colour.contains("\x1b["));
    assert_eq!(error.diagnostics()[0].span, 24..26);
}

#[test]
fn a_forgotten_image_name_is_suspected() {
    let error = parse(b"640 480\n1\n0\n0\n0\n", "a.in").unwrap_err();
    let help = error.diagnostics()[0].help.as_deref().unwrap();
    assert_eq!(help, "the file's first token is the image name, and here it is a number: is the name missing?");
}

#[test]
fn of_a_long_line_only_the_part_around_the_token_is_shown() {
    let source = format!("a.png 640 480 1 0 0 1 {}x {}", "1 ".repeat(11), "1 ".repeat(5_000_000));
    let error = parse_bounded(source.as_bytes()).unwrap_err();
    assert_eq!(
        error.render(false),
        "\
error: triangle 1's z3 is not a number
 --> test.in:1:45
  |
1 | a.png 640 480 1 0 0 1 1 1 1 1 1 1 1 1 1 1 1 x 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1...
  |                                             ^ expected a number

error: the scene is complete here, and more follows
 --> test.in:1:47
  |
1 | a.png 640 480 1 0 0 1 1 1 1 1 1 1 1 1 1 1 1 x 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1...
  |                                               ^ expected the end of the file
  |
  = help: line 1 announces 1 triangle: correct the count or remove the 5000000 tokens from here on"
    );

    let source = format!("{} 640 480 {}", "ñ".repeat(1_000_000), "é".repeat(1_000_000));
    let error = parse_bounded(source.as_bytes()).unwrap_err();
    assert!(
        error.to_string().starts_with("error: the focal distance is not a number\n --> test.in:1:1000010\n"),
        "{error}"
    );
    assert!(error.to_string().len() < 1000 && error.lines().iter().all(|line| line.len() < 300), "{error}");
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scene_files");
    fs::create_dir_all(&folder).unwrap();
    let missing = folder.join("missing.in");
    let error = read(&missing).unwrap_err();
    assert_eq!(error.lines(), [format!("there is no scene file `{}`", missing.display())]);
    assert!(error.diagnostics().is_empty());

    let huge = folder.join("huge.in");
    fs::File::create(&huge).unwrap().set_len((4 << 30) + 1).unwrap();
    let error = read(&huge).unwrap_err().to_string();
    fs::remove_file(&huge).unwrap();
    assert!(error.ends_with("cannot be read: it has more than 4096 MiB, too many for a scene"), "{error}");
}

#[cfg(unix)]
#[test]
fn a_device_without_an_end_is_not_read_to_the_end() {
    let error = read(Path::new("/dev/zero")).unwrap_err().to_string();
    assert!(error.ends_with("`/dev/zero` cannot be read: it has more than 64 MiB, too many for a scene"), "{error}");
}

#[test]
fn scenes_of_the_project_name_images_after_themselves() {
    let files = scenes();
    assert!(files.len() >= 5, "{files:?}");
    for file in files {
        let scene = read(&file).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(accepted(fs::read(&file).unwrap()), scene);
        assert_eq!(Path::new(&scene.name), file.with_extension("png").file_name().unwrap());
        assert_eq!(accepted(scene.to_text()), scene);
    }
}

#[test]
fn the_scene_of_many_objects_is_made_from_its_seed() {
    let file = scenes().into_iter().find(|file| file.ends_with("many.in")).unwrap();
    assert!(fs::read_to_string(file).unwrap() == many(300, 300, 5).to_text(), "many(300, 300, 5) is not many.in");
}

#[test]
fn the_generator_is_the_published_one() {
    let mut rng = Rng::new(1_234_567);
    // The reference values published with the algorithm.
    assert_eq!([rng.next_u64(), rng.next_u64()], [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
    assert!((0..10_000).all(|_| (0.0..1.0).contains(&rng.next_f32())));
}

#[test]
fn many_makes_scenes_of_any_size_that_the_format_can_hold() {
    for (spheres, triangles) in [(0, 0), (1, 0), (0, 1), (2000, 1000)] {
        let scene = many(spheres, triangles, 9);
        assert_eq!((scene.spheres.len(), scene.triangles.len()), (spheres, triangles));
        assert_eq!(accepted(scene.to_text()), scene);
        let seen = |p: &Vec3| p.x.abs() <= 0.401 * p.z && p.y.abs() <= 0.301 * p.z;
        assert!(scene.spheres.iter().all(|sphere| seen(&sphere.centre)));
    }
}

#[test]
fn what_the_format_cannot_hold_is_written_as_close_as_it_can_be() {
    let mut scene = accepted(VALID);
    scene.camera = Camera::new(640, 480, 35.0, 35.0).unwrap();
    scene.shadows = true;
    for (name, written) in [("", "image"), ("a b#c.png", "a_b_c.png"), ("x///y\n", "x/_/y_")] {
        scene.name = name.to_owned();
        let text = scene.to_text();
        assert!(text.contains("# (for a film diagonal of 35, which is not part of this format)"), "{text}");
        assert!(text.contains("# (with shadows, which are not part of this format)"), "{text}");
        let read = accepted(&text);
        assert_eq!(read.name, written);
        assert_eq!((read.camera, read.shadows), (Camera::new(640, 480, 35.0, 1.0).unwrap(), false));
    }
}

#[test]
fn memory_follows_the_file_and_not_its_counts() {
    // The shortest tokens give the most objects per byte.
    let dense = |head: &str, tokens: usize, tail: &str| {
        let count = 300_000 / tokens;
        format!("a 9 9 1 {head}{count} {}{tail}", "1 ".repeat(count * tokens))
    };
    accepted(dense("", 7, "0 0"));
    accepted(dense("0 ", 7, "0"));
    accepted(dense("0 0 ", 12, ""));
    for count in ["1000000000000000000", "18446744073709551615", "300001", "40000"] {
        let lines = refused(format!("a 9 9 1 0 {count} {}", "1 ".repeat(200_000)));
        assert!(lines[0].contains("the sphere count is larger than what follows"), "{lines:?}");
    }
    // A file in which every object is invalid.
    assert_eq!(refused(dense("0 0 ", 12, "").replace("1 1 1 1 ", "x x x x ")).len(), 21);
    // As much white space as the tokens of the claimed count would need.
    refused(format!("a 9 9 1 0 0 100000 {}", " ".repeat(3_000_000)));
}

/// All of a scene as text, which distinguishes -0 from 0.
fn bits(scene: &impl std::fmt::Debug) -> String {
    format!("{scene:?}")
}

#[test]
fn a_scene_that_is_written_and_read_is_the_same_bit_by_bit() {
    let mut rng = Rng::new(1);
    for seed in 0..300 {
        // Random finite numbers, or their absolute values where negative numbers are invalid.
        let mut number =
            || std::iter::repeat_with(|| f32::from_bits(rng.next_u64() as u32)).find(|x| x.is_finite()).unwrap();
        let mut point = || Vec3::from_array([(); 3].map(|()| number()));
        let mut scene = many(3, 3, seed);
        for Light { intensity, colour, position } in &mut scene.lights {
            (*intensity, *colour, *position) = (point().x.abs(), point().abs(), point());
        }
        for Sphere { radius, colour, centre } in &mut scene.spheres {
            (*radius, *colour, *centre) = (point().x.abs().max(f32::from_bits(1)), point().abs(), point());
        }
        for Triangle { colour, vertices } in &mut scene.triangles {
            (*colour, *vertices) = (point().abs(), vertices.map(|_| point()));
        }
        scene.camera = Camera::new(640, 480, point().x.abs().max(f32::from_bits(1)), 1.0).unwrap();
        let text = scene.to_text();
        assert_eq!(bits(&accepted(&text)), bits(&scene));
        // A number that ends with a comment is read by the slower parser.
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        let with_care: String = lines.map(|line| line.replace(' ', "#\n") + "#\n").collect();
        assert_eq!(bits(&accepted(with_care)), bits(&scene));
    }
}

/// The help about the first line that does not fit, from the first error.
fn misfit(source: &str) -> Option<String> {
    let error = parse(source.as_bytes(), "a scene of this test").unwrap_err();
    let help = error.diagnostics()[0].help.clone()?;
    let said = help.strip_suffix(": look there first")?;
    Some(said.rsplit("; ").next().unwrap().to_owned())
}

#[test]
fn first_line_that_does_not_fit_a_count_is_named() {
    let scene = "x.png\n9 9\n1\n2 # lights\n1  1 1 1  0 5 0\n1  1 1 1  0 5 0\n\n1\n2  1 1 1  0 0 9\n0\n";
    assert!(parse(scene.as_bytes(), "a scene of this test").is_ok());
    let said = |line: &str, of_line: &str| Some(format!("line {line} has {of_line}"));
    for (from, to, expected) in [
        // A missing number, in the first light and in the last one.
        ("1  1 1 1  0 5 0\n1 ", "1  1 1 1  0 5\n1 ", said("5", "6 of the 7 numbers of light 1")),
        ("0 5 0\n\n", "0 5\n\n", said("6", "6 of the 7 numbers of light 2")),
        // One number too many.
        ("1  1 1 1  0 5 0\n1 ", "1  1 1 1  0 5 0 0\n1 ", said("5", "8 numbers, and a light takes 7")),
        // One light more, and one fewer, than the count says.
        ("2 # lights", "3 # lights", said("8", "1 of the 7 numbers of light 3")),
        ("2  1 1 1  0 0 9", "2  1 1 1  0 0", said("9", "6 of the 7 numbers of sphere 1")),
        // With CR LF line ends, and after a comment.
        ("1  1 1 1  0 5 0\n1 ", "# 1 2 3\r\n1  1 1 1  0 5\r\n1 ", said("6", "6 of the 7 numbers of light 1")),
        // An invalid number is reported at its own place only.
        ("0 5 0\n1 ", "0 5 x\n1 ", None),
        // Items that are deliberately written in several lines.
        ("2 # lights\n1  1 1 1  0 5 0\n1  1 1 1  0 5 0\n\n1\n", "2\n1 1 1 1\n0 5 0\n1 1 1 1\n0 5 0\n\nmany\n", None),
    ] {
        assert!(scene.contains(from), "{from}");
        assert_eq!(misfit(&scene.replacen(from, to, 1)), expected, "{from:?} to {to:?}");
        // A byte order mark makes no difference.
        assert_eq!(misfit(&format!("\u{feff}{}", scene.replacen(from, to, 1))), expected, "{from:?} to {to:?}");
    }
}
