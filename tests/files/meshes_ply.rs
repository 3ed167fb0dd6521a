//! PLY files in the variants that programs write: their numbers, lines, colours and headers.

use rayo::internals::scene::{Mesh, MeshFormat};

use crate::meshes::{colours, read, refused, soup};

/// The vertices and faces of the pyramid that the files of these tests contain.
const VERTICES: [&str; 5] = ["-1 0 -1", "1 0 -1", "1 0 1", "-1 0 1", "0.25 1.5 0.25"];
const FACES: [&str; 6] = ["3 0 1 4", "3 1 2 4", "3 2 3 4", "3 3 0 4", "3 0 2 1", "3 0 3 2"];

/// A header for the pyramid, with additional properties of vertices.
fn header(more: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n{more}\
         element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

fn lines(lines: &[&str]) -> String {
    lines.iter().map(|line| format!("{line}\n")).collect()
}

fn pyramid() -> String {
    header("") + &lines(&VERTICES) + &lines(&FACES)
}

fn pyramid_soup() -> Vec<[[f32; 3]; 3]> {
    soup(&read(MeshFormat::Ply, pyramid()).unwrap())
}

fn ply(source: impl Into<Vec<u8>>) -> Mesh {
    read(MeshFormat::Ply, source).unwrap()
}

#[test]
fn numbers_of_a_text_may_lack_digits_on_either_side() {
    for numbers in [
        ["-1. 0 -1", "+1 0 -1", "1 0 1", "-1.e0 .0 1", ".25 1.5 0.25"],
        ["-1 -0. -1", "1e+00 0e0 -1", "1.E0 +.0 01", "-10.e-1 0 1", "2.5e-1 15.e-1 +.25"],
    ] {
        assert_eq!(soup(&ply(header("") + &lines(&numbers) + &lines(&FACES))), pyramid_soup(), "{numbers:?}");
    }
    // A property that is not read may contain any spelling of NaN or infinity.
    let normal = "property float nx\n";
    for nan in ["nan", "-nan", "-nan(ind)", "1.#QNAN", "-1.#IND", "inf", "-1.#INF"] {
        let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} {nan}\n")).collect();
        assert_eq!(soup(&ply(header(normal) + &vertices + &lines(&FACES))), pyramid_soup(), "{nan}");
        let nowhere = "test:10: vertex 1 is not finite: expected numbers that f32 holds, within 3.4e38";
        assert_eq!(refused(MeshFormat::Ply, pyramid().replace("-1 0 -1\n1", &format!("-1 0 {nan}\n1"))), nowhere);
    }
    let f32s = ply(pyramid().replace("0.25 1.5 0.25", "0.1 16777217 8.589973e9"));
    assert_eq!(f32s.vertices[4].to_array(), [0.1, 16_777_217.0, 8.589973e9]);
}

#[test]
fn words_of_a_text_may_stand_in_any_lines() {
    let (vertices, faces) = (lines(&VERTICES), lines(&FACES));
    let halves: String = VERTICES.iter().map(|vertex| format!("{vertex}\n0 0 1\n")).collect();
    let normals = "property float nx\nproperty float ny\nproperty float nz\n";
    let noted =
        |line| vec![format!("elements do not end with lines, from line {line} on: their numbers were read in order")];
    for (what, source, notes) in [
        ("an empty line behind the header", header("") + "\n" + &vertices + &faces, vec![]),
        ("an empty line between elements", header("") + &vertices + " \t\n\n" + &faces, vec![]),
        ("CR LF", pyramid().replace('\n', "\r\n").replace("end_header\r\n", "end_header\r\n\r\n"), vec![]),
        ("CR", pyramid().replace('\n', "\r"), vec![]),
        ("tabs and blanks", pyramid().replace(' ', " \t ").replace("\n", " \n\t"), vec![]),
        ("a vertex in two lines", header(normals) + &halves + &faces, vec!["not read: normals".to_owned()]),
        ("counts by themselves", header("") + &vertices + &faces.replace("3 ", "3\n"), vec![]),
        ("one line", header("") + &(vertices.clone() + &faces).replace('\n', " "), noted(10)),
        ("a line of vertices", header("") + &vertices.replace('\n', " ") + "\n" + &faces, noted(10)),
        ("a word a line", header("") + &(vertices.clone() + &faces).replace(' ', "\n"), vec![]),
        ("wrapped lines", header("") + &(vertices.clone() + &faces).replace('\n', " ").replace("1 ", "1\n"), noted(18)),
    ] {
        let mesh = read(MeshFormat::Ply, source).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!((soup(&mesh), mesh.notes), (pyramid_soup(), notes), "{what}");
    }
    // A missing number shifts all that follow: the error tells where that began.
    let short = refused(MeshFormat::Ply, pyramid().replace("1 0 1\n-1", "1 0\n-1"));
    assert!(short.contains("; line 13 does not end with an element, and numbers may be missing before"), "{short}");
    // If lines have more numbers than properties, each element has a line of its own.
    let longer = pyramid().replace("-1 0 -1\n", "-1 0 -1 9 9 9\n").replace("1 0 1\n-1", "1 0\n-1");
    let too_short = "test:12: vertex 3 cannot be understood: expected its properties as the header lists them: x y z";
    assert_eq!(refused(MeshFormat::Ply, longer), too_short);
}

#[test]
fn whole_numbers_may_be_written_with_a_point() {
    let colour = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let coloured = |red: &str| {
        let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} {red} 0.0 0\n")).collect();
        header(colour) + &vertices + &lines(&FACES)
    };
    assert_eq!(colours(&ply(coloured("255.000000"))), [[1.0, 0.0, 0.0]; 6]);
    let faces = FACES.map(|face| face.replace(' ', ".0 ") + ".000000");
    assert_eq!(soup(&ply(header("") + &lines(&VERTICES) + &faces.join("\n"))), pyramid_soup());
    for red in ["256", "-1", "0.5", "nan", "red"] {
        let expected = "expected a whole number from 0 to 255, as its type uchar says";
        assert_eq!(refused(MeshFormat::Ply, coloured(red)), format!("test:13: vertex 1's red is `{red}`: {expected}"));
    }
    let odd = |face: &str| refused(MeshFormat::Ply, pyramid().replace("3 1 2 4", face));
    let [corner, count] = [
        "a whole number from -2147483648 to 2147483647, as its type int says",
        "a whole number from 0 to 255, as its type uchar says",
    ];
    assert_eq!(odd("3 1 2.5 4"), format!("test:16: face 2's vertex_indices is `2.5`: expected {corner}"));
    assert_eq!(odd("-1 1 2 4"), format!("test:16: face 2's vertex_indices is `-1`: expected {count}"));
    let help = "the decimal mark is a point, and white space alone separates numbers";
    assert_eq!(odd("3 1 2 4,"), format!("test:16: face 2's vertex_indices is `4,`: expected {corner}; {help}"));
    let comma = refused(MeshFormat::Ply, pyramid().replace("0.25 1.5", "0,25 1.5"));
    assert_eq!(comma, format!("test:14: vertex 5's x is `0,25`: expected a number, as its type float says; {help}"));
}

#[test]
fn colours_have_any_type_and_one_of_three_names() {
    const RED: [f32; 3] = [1.0, 0.0, 0.0];
    for (kind, full) in [
        ("uchar", "255"),
        ("ushort", "65535"),
        ("int", "255"),
        ("uint", "255"),
        ("short", "255"),
        ("float", "1"),
        ("double", "1.0"),
        ("uint8", "255"),
        ("float32", "1e0"),
    ] {
        for names in [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]] {
            let properties = names.map(|name| format!("property {kind} {name}\n")).concat();
            let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} {full} 0 0\n")).collect();
            let mesh = ply(header(&properties) + &vertices + &lines(&FACES));
            assert_eq!((colours(&mesh), mesh.notes), (vec![RED; 6], vec![]), "{kind} {names:?}");
        }
    }
    let with = |properties: &str, numbers: &str| {
        let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} {numbers}\n")).collect();
        ply(header(properties) + &vertices + &lines(&FACES))
    };
    let floats = ["red", "green", "blue"].map(|name| format!("property float {name}\n")).concat();
    let bright = with(&floats, "255 0 0");
    assert_eq!(bright.notes, ["colours exceed 1, and are taken as they are"]);
    assert!(colours(&bright)[0][0] > 1.0);
    let diffuse = floats.replace("float ", "float diffuse_");
    assert_eq!(colours(&with(&(diffuse + &floats), "0 0 1 1 0 0"))[0], RED);
    let part = with("property uchar red\nproperty uchar green\n", "255 0");
    assert_eq!(part.notes, ["not read: colours of less than red, green and blue"]);
    assert!(part.colours.is_empty());
}

#[test]
fn a_byte_that_says_it_has_a_sign_is_a_level_all_the_same() {
    let mut file = header("property char red\nproperty char green\nproperty char blue\n")
        .replace("ascii", "binary_little_endian")
        .into_bytes();
    for vertex in VERTICES {
        file.extend(vertex.split(' ').flat_map(|number| number.parse::<f32>().unwrap().to_le_bytes()));
        file.extend([255, 0, 0]);
    }
    for face in FACES.map(|face| face.split(' ').map(|number| number.parse().unwrap()).collect::<Vec<i32>>()) {
        file.push(3);
        file.extend(face[1..].iter().flat_map(|corner| corner.to_le_bytes()));
    }
    let mesh = ply(file);
    assert_eq!((soup(&mesh), colours(&mesh)), (pyramid_soup(), vec![[1.0, 0.0, 0.0]; 6]));
}

#[test]
fn colours_of_faces_are_preferred_to_those_of_vertices() {
    let colour = "property uint8 red\nproperty uint8 green\nproperty uint8 blue\nproperty uint8 alpha\n";
    let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} 0 255 0 255\n")).collect();
    let faces: String = FACES.iter().map(|face| format!("{face} 255 0 0 255\n")).collect();
    let source = header(colour).replace("end_header\n", &format!("{colour}end_header\n")) + &vertices + &faces;
    let mesh = ply(source);
    assert_eq!((colours(&mesh), mesh.notes), (vec![[1.0, 0.0, 0.0]; 6], vec!["not read: transparency".to_owned()]));
    let twice = refused(MeshFormat::Ply, pyramid().replace("property float y", "property int q\nproperty int q"));
    assert_eq!(twice, "test: the header names an element or a property twice: expected a name once");
}

#[test]
fn lists_have_counts_and_corners_of_any_type() {
    for list in ["ushort uint", "uint8 int32", "int int", "uchar float", "float double", "uint char"] {
        let source = pyramid().replace("list uchar int", &format!("list {list}"));
        assert_eq!(soup(&ply(source)), pyramid_soup(), "{list}");
    }
    let floats = pyramid().replace("list uchar int", "list uchar float").replace("3 1 2 4", "3 1 2.5 4");
    assert_eq!(refused(MeshFormat::Ply, floats), "test:16: face 2's vertex_indices is `2.5`: expected a whole number");
    let char_count = pyramid().replace("list uchar", "list char");
    let negative = refused(MeshFormat::Ply, char_count.replace("3 1 2 4", "-1 1 2 4"));
    assert_eq!(negative, "test:16: face 2's vertex_indices is `a list of -1`: expected 0 numbers or more");
    let mut binary = char_count.replace("ascii", "binary_little_endian");
    binary.truncate(binary.find("end_header\n").unwrap() + 11);
    let binary = [binary.as_bytes(), &[0; 5 * 12], &[0xff; 90]].concat();
    let negative = refused(MeshFormat::Ply, binary);
    assert_eq!(negative, "test: face 1's vertex_indices is `a list of -1`: expected 0 numbers or more");
    let claim = refused(MeshFormat::Ply, pyramid().replace("element vertex 5", "element vertex -1"));
    assert!(claim.starts_with("test:3: the header cannot be understood: "), "{claim}");
}

#[test]
fn numbers_of_64_bits_are_read_as_programs_write_them() {
    for long in ["int64", "uint64"] {
        for list in [format!("uchar {long}"), format!("{long} int"), format!("{long}  {long}")] {
            let source = pyramid().replace("list uchar int", &format!("list {list}"));
            assert_eq!(soup(&ply(source)), pyramid_soup(), "{list}");
        }
        let places = pyramid().replace("property float z", &format!("property float z\nproperty {long} id"));
        let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} 7\n")).collect();
        assert_eq!(soup(&ply(places.replace(&lines(&VERTICES), &vertices))), pyramid_soup(), "{long}");
        for order in ["little", "big"] {
            let header = header(&format!("property {long} id\n")).replace("ascii", &format!("binary_{order}_endian"));
            let mut file = header.replace("list uchar int", &format!("list uchar {long}")).into_bytes();
            let is_big = order == "big";
            let long = |number: i64| if is_big { number.to_be_bytes() } else { number.to_le_bytes() };
            for vertex in VERTICES {
                for number in vertex.split(' ').map(|number| number.parse::<f32>().unwrap()) {
                    file.extend(if is_big { number.to_be_bytes() } else { number.to_le_bytes() });
                }
                file.extend(long(-1));
            }
            for face in FACES.map(|face| face.split(' ').map(|number| number.parse().unwrap()).collect::<Vec<i64>>()) {
                file.push(3);
                file.extend(face[1..].iter().flat_map(|corner| long(*corner)));
            }
            assert_eq!(soup(&ply(file.clone())), pyramid_soup(), "{order}");
            let end = file.len() - 8;
            file[end..].copy_from_slice(&long(5));
            let error = refused(MeshFormat::Ply, file);
            assert!(
                error.contains("face 6's corner 3 refers to vertex 5, but the file has only 5 vertices"),
                "{error}"
            );
        }
    }
    let beyond = refused(
        MeshFormat::Ply,
        pyramid().replace("list uchar int", "list uchar uint64").replace("3 0 1 4", "3 -1 1 4"),
    );
    assert!(beyond.contains("face 1's vertex_indices is `-1`"), "{beyond}");
    assert!(beyond.ends_with("as its type uint64 says"), "{beyond}");
}

#[test]
fn floats_of_16_bits_are_read_as_programs_write_them() {
    // The 16-bit floats of these numbers, of the smallest and the largest one, and of infinity.
    let halves = [(-1.0, 0xbc00_u16), (0.0, 0), (1.0, 0x3c00), (0.25, 0x3400), (1.5, 0x3e00)];
    let half = |number: f32| halves.iter().find(|(value, _)| *value == number).unwrap().1;
    for (name, order) in [("float16", "little"), ("half", "big")] {
        let header = header("").replace("ascii", &format!("binary_{order}_endian")).replace("float", name);
        let bytes = |bits: u16| if order == "big" { bits.to_be_bytes() } else { bits.to_le_bytes() };
        let corner = |index: i32| if order == "big" { index.to_be_bytes() } else { index.to_le_bytes() };
        let file = |replaced: Option<u16>| {
            let mut file = header.clone().into_bytes();
            let numbers =
                VERTICES.iter().flat_map(|vertex| vertex.split(' ')).map(|number| half(number.parse().unwrap()));
            let mut bits: Vec<_> = numbers.collect();
            bits[12] = replaced.unwrap_or(bits[12]);
            file.extend(bits.into_iter().flat_map(bytes));
            for face in FACES.map(|face| face.split(' ').map(|number| number.parse().unwrap()).collect::<Vec<i32>>()) {
                file.push(3);
                file.extend(face[1..].iter().flat_map(|index| corner(*index)));
            }
            file
        };
        assert_eq!(soup(&ply(file(None))), pyramid_soup(), "{name}");
        for (bits, value) in [(0x8001, -(2_f32.powi(-24))), (0x7bff, 65504.0), (0x0400, 2_f32.powi(-14))] {
            assert!(ply(file(Some(bits))).vertices.iter().any(|vertex| vertex.x == value), "{name} {bits:x}");
        }
        for bits in [0x7c00, 0x7e00, 0xfc00] {
            let nowhere = "test: vertex 5 is not finite: expected numbers that f32 holds, within 3.4e38";
            assert_eq!(refused(MeshFormat::Ply, file(Some(bits))), nowhere);
        }
    }
    let colour = "property half red\nproperty half green\nproperty half blue\n";
    let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} 1 0 0\n")).collect();
    assert_eq!(colours(&ply(header(colour) + &vertices + &lines(&FACES))), [[1.0, 0.0, 0.0]; 6]);
    for (types, unknown) in [("list uchar long", "long"), ("list byte int", "byte")] {
        let error = refused(MeshFormat::Ply, pyramid().replace("list uchar int", types));
        let expected = format!("test:8: `{unknown}` is no type of a property: expected one of char uchar short ");
        assert!(error.starts_with(&expected), "{error}");
        assert!(error.ends_with(" float64 int64 uint64 float16 half"), "{error}");
    }
}

#[test]
fn colours_of_16_bits_with_levels_of_8_are_told() {
    let colour = "property ushort red\nproperty ushort green\nproperty ushort blue\n";
    let mesh = |level: u32| {
        let vertices: String = VERTICES.iter().map(|vertex| format!("{vertex} {level} 0 0\n")).collect();
        ply(header(colour) + &vertices + &lines(&FACES))
    };
    let told = "colours of 16 bits do not exceed 255 of 65535: if bytes are meant, their type is uchar";
    assert_eq!(mesh(255).notes, [told]);
    assert_eq!(mesh(1).notes, [told]);
    for level in [0, 256, 65535] {
        assert!(mesh(level).notes.is_empty(), "{level}");
    }
}

#[test]
fn a_vertex_that_is_not_finite_matters_only_to_its_faces() {
    let more = pyramid().replace("element vertex 5", "element vertex 8");
    let places = "nan 0 0\n-1 0 -1\n1 0 -1\n1e99 0 0\n1 0 1\n-1 0 1\n0.25 1.5 0.25\n0 0 inf\n";
    // The indices of the pyramid's vertices among all vertices of this file.
    let indices = [1, 2, 4, 5, 6];
    let shifted = |face: &str| {
        let (count, corners) = face.split_once(' ').unwrap();
        let corners = corners.split(' ').map(|corner| indices[corner.parse::<usize>().unwrap()].to_string());
        format!("{count} {}\n", corners.collect::<Vec<_>>().join(" "))
    };
    let faces = FACES.map(shifted).concat();
    let with_others = more.replace(&lines(&VERTICES), places).replace(&lines(&FACES), &faces);
    let mesh = ply(with_others.clone());
    assert_eq!((soup(&mesh), mesh.vertices.len()), (pyramid_soup(), 5));
    // The error names the first such vertex that is a corner of a face, not the first in the file.
    let used = refused(MeshFormat::Ply, with_others.replace("3 1 2 6\n", "3 1 3 6\n"));
    assert_eq!(used, "test:13: vertex 4 is not finite: expected numbers that f32 holds, within 3.4e38");
    // The same holds for OBJ.
    let obj = "v nan 0 0\nv 0 0 0\nv 1 0 0\nv 1e99 0 0\nv 0 1 0\nf 2 3 5\n";
    assert_eq!(read(MeshFormat::Obj, obj).unwrap().vertices.len(), 3);
    let used = refused(MeshFormat::Obj, obj.replace("2 3 5", "2 4 5"));
    assert_eq!(used, "test:4: vertex 4 is not finite: expected numbers that f32 holds, within 3.4e38");
    let weight = refused(MeshFormat::Obj, obj.replace("v 1 0 0", "v 1 0 0 inf"));
    assert_eq!(weight, "test:3: vertex 3 is not finite: expected numbers that f32 holds, within 3.4e38");
}

#[test]
fn a_file_of_points_is_refused_for_its_faces() {
    let points = header("") + &lines(&VERTICES);
    let none = points.replace("element face 6", "element face 0");
    assert_eq!(refused(MeshFormat::Ply, none), "test: the mesh is empty: expected at least one face");
    let camera = points
        .replace("element face 6\nproperty list uchar int vertex_indices", "element camera 1\nproperty float view");
    let expected = "test: the header has no faces: expected element face, with its number";
    assert_eq!(refused(MeshFormat::Ply, camera + "1\n"), expected);
}

#[test]
fn faces_of_less_than_three_corners_are_left_out() {
    let mesh = ply(pyramid().replace("element face 6", "element face 9") + "2 0 1\n0\n1 4\n");
    assert_eq!(soup(&mesh), pyramid_soup());
    assert_eq!(mesh.notes, ["3 faces of less than three corners left out"]);
}

#[test]
fn a_header_may_be_written_in_many_ways() {
    let text = pyramid();
    let comment = |comment: &[u8]| {
        let at = text.find("element vertex").unwrap();
        [&text.as_bytes()[..at], comment, &text.as_bytes()[at..]].concat()
    };
    for source in [
        comment(b"comment\n"),
        comment(b"obj_info\n"),
        comment(b"comment \xe9t\xe9\ncomment\n\n"),
        text.replace("format", "comment first\nformat").into_bytes(),
        text.replace("ascii 1.0", "ascii 1").into_bytes(),
        text.replace("format ascii 1.0", " format\tascii  1 ").into_bytes(),
        text.replacen("property float", "property\tfloat", 2).into_bytes(),
        text.replace("element face", "  element  face").into_bytes(),
        text.replace("end_header\n", "end_header \n").into_bytes(),
    ] {
        assert_eq!(soup(&ply(source.clone())), pyramid_soup(), "{}", source.escape_ascii());
    }
}

#[test]
fn a_binary_file_begins_right_behind_the_line_of_its_header() {
    for order in ["little", "big"] {
        for (first, line_end) in [(0x0a, "\n"), (0x0d, "\n"), (0x20, "\n"), (0x0a, "\r\n"), (0x0d, "\r\n")] {
            let header = format!(
                "ply\nformat binary_{order}_endian 1.0\nelement vertex 3\nproperty uchar quality\nproperty float x\n\
                 property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
            );
            let mut file = header.replace('\n', line_end).into_bytes();
            for place in [[1.0_f32, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 10.0]] {
                file.push(first);
                for number in place {
                    file.extend(if order == "big" { number.to_be_bytes() } else { number.to_le_bytes() });
                }
            }
            file.push(3);
            for corner in 0..3_i32 {
                file.extend(if order == "big" { corner.to_be_bytes() } else { corner.to_le_bytes() });
            }
            assert_eq!(soup(&ply(file)), [[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 10.0]]], "{order} {first}");
        }
    }
}

#[test]
fn the_extension_of_a_mesh_may_be_in_capitals() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = ply(pyramid());
    for (name, format) in [("a.PLY", MeshFormat::Ply), ("a.Obj", MeshFormat::Obj), ("a.STL", MeshFormat::Stl)] {
        let mut bytes = Vec::new();
        mesh.write(format, &mut bytes).unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(soup(&Mesh::read(&path).unwrap()), pyramid_soup(), "{name}");
    }
}
