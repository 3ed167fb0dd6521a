//! OBJ and MTL files in the variants that programs write, and files that are no meshes.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use rayo::internals::scene::{Mesh, MeshFormat, SceneFormat, open, parse, parse_toml};

use crate::meshes::{OBJ_SQUARE, colours, fan, light, read, refused, soup};

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const BLUE: [f32; 3] = [0.0, 0.0, 1.0];
const WHITE: [f32; 3] = [1.0; 3];
const COMMA: &str = "the decimal mark is a point, and white space alone separates numbers";

/// Reads an OBJ file that has other files in its folder.
fn read_beside(files: &[(&str, &str)], obj: impl AsRef<[u8]>) -> Mesh {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let path = folder.path().join("mesh.obj");
    fs::write(&path, obj).unwrap();
    Mesh::read(&path).unwrap()
}

/// A square whose first triangle has the material red and whose second one has blue.
fn red_and_blue(libraries: &str) -> String {
    format!("{libraries}{OBJ_SQUARE}usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n")
}

const MATERIALS: &str = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n";

#[test]
fn obj_has_colours_of_vertices_or_of_materials() {
    const RED: [f32; 3] = [1.0, 0.0, 0.0];
    let vertices = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 0 0 0.5 1\n";
    let mesh = read(MeshFormat::Obj, format!("{vertices}f 1 2 3 4\nf 4 4 4")).unwrap();
    assert_eq!(colours(&mesh), [RED, [2.0 / 3.0, 0.0, light(0.5) / 3.0], [0.0, 0.0, light(0.5)]]);
    // A vertex without a colour is white; three numbers that are no valid colour are ignored.
    let mesh = read(MeshFormat::Obj, format!("{vertices}v 1 2 3\nv 1 2 3 -1 0 0\nf 5 5 6\nf 1 2 3")).unwrap();
    assert_eq!(colours(&mesh), [[1.0; 3], RED]);
    assert!(
        read(MeshFormat::Obj, format!("{OBJ_SQUARE}v 0 0 0 1 2\nvn 0 0 1\nvt 0 0\nf 1 2 3 # red"))
            .unwrap()
            .colours
            .is_empty()
    );

    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write(
        "my box.mtl",
        "\u{feff}newmtl red\nKa 1 1 1\nKd 1 0 0\nd 0.5\r\nnewmtl plain\nmap_Kd a.png\n newmtl\tblue\n\tKd 0 0 .5 # dark\n",
    );
    let faces = "f 1 2 3\nusemtl red\nf 1 2 3 4\nusemtl  blue \nf 1 2 3\nusemtl none\nf 1 2 3\nusemtl plain\nf 1 2 3\n";
    for before in ["", "# ends in \\\n"] {
        write("box.obj", &format!("\u{feff}mtllib my box.mtl\n{before}{OBJ_SQUARE}vn 0 0 1\n{faces}"));
        let mesh = Mesh::read(&folder.path().join("box.obj")).unwrap();
        assert_eq!(colours(&mesh), [[1.0; 3], RED, RED, [0.0, 0.0, light(0.5)], [1.0; 3], [1.0; 3]]);
        assert_eq!(
            mesh.notes,
            ["not read: normals", "not read: materials that no file describes, textures, transparency"]
        );
    }
    assert_eq!(Mesh::read(&folder.path().join("box.obj")).unwrap().libraries, [folder.path().join("my box.mtl")]);
    write("lost.obj", &format!("mtllib lost.mtl\n{OBJ_SQUARE}{faces}"));
    let lost = Mesh::read(&folder.path().join("lost.obj")).unwrap();
    let note = "the materials in `lost.mtl` cannot be read: ";
    assert!(
        matches!(&lost.notes[..], [one] if one.starts_with(note) && one.ends_with("(os error 2)")),
        "{:?}",
        lost.notes
    );
    assert!(lost.colours.is_empty());
    write("partly.obj", &format!("mtllib lost.mtl box.mtl\n{OBJ_SQUARE}{faces}"));
    write("box.mtl", "newmtl red\nKd 1 0 0\n");
    assert_eq!(colours(&Mesh::read(&folder.path().join("partly.obj")).unwrap())[1], RED);
    write("both.obj", &format!("mtllib my box.mtl\n{OBJ_SQUARE}v 0 0 0 1 0 0\nusemtl blue\nf 1 2 3\nf 5 5 5\n"));
    let both = Mesh::read(&folder.path().join("both.obj")).unwrap();
    assert_eq!(both.notes, ["not read: materials, since vertices have colours"]);
}

#[test]
fn an_obj_file_may_be_written_in_many_ways() {
    for (way, faces) in [
        ("a quad", "f 1 2 3 4"),
        ("two triangles", "f 1 2 3\nf 1 3 4"),
        ("numbers from the end", "f -4 -3 -2 -1"),
        ("texture and normal", "vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1"),
        ("normals alone", "vn 0 0 1\nf 1//1 2//1 3//1 4//1"),
        ("texture and normals that are not there", "f 1/9/9 2/-7 3//8 4/0/0"),
        (
            "lines that mean nothing here",
            "o square\ng a b\nmtllib no.mtl\nusemtl no\ns off\nl 1 2\np 3\nf 1 2 3 4\n# \u{f1}",
        ),
        ("several objects", "o one\nf 1 2 3\no two\nf 1 3 4"),
        ("a line that goes on", "f 1 2 \\\n 3 4"),
        ("all white space of C", "v\x0b9 9 9\nf\x0b1\x0c2\t3\x0b4\nv\t8\x0b8\x0c8"),
        ("what C writes for no number", "v -nan(ind) nan -1.#IND\nv 1.#QNAN 1.#inf 1.#SNAN # none\nf 1 2 3 4"),
        ("CR LF", "f 1 2 3 4\r"),
        ("a fifth vertex that no face has", "v 9 9 9\nf 1 2 3 4"),
    ] {
        for mark in ["", "\u{feff}"] {
            let mesh = read(MeshFormat::Obj, format!("{mark}{OBJ_SQUARE}{faces}\n"));
            assert_eq!(soup(&mesh.unwrap_or_else(|error| panic!("{way}: {error}"))), fan(), "{way}");
        }
    }
    let quad = read(MeshFormat::Obj, format!("{OBJ_SQUARE}f 1 2 3 4\nf 1 2 3\nf 1 2 3 4 1")).unwrap();
    assert_eq!((quad.polygons, quad.triangles.len()), (2, 6));
    // Colours on some vertices, a weight, and a comment in Latin-1.
    let odd = b"# se\xf1al\nv 0 0 0 1 0 0\nv 2 0 0 2\nv 1 1 0.5\nv 0 1 -2.5e-7 0 1 0\nf 1 2 3 4".to_vec();
    assert_eq!(soup(&read(MeshFormat::Obj, odd).unwrap()), fan());
}

#[test]
fn a_bad_obj_file_is_refused_at_its_line_and_element() {
    let has = "expected 1 to 4, the number of its vertices, or -1 and down for the last ones";
    let corner = "expected vertex numbers, as in 7, 7/1, 7/1/2 or 7//2";
    let point = "expected three numbers after v: x y z";
    for (faces, expected) in [
        (
            "",
            "test: the mesh is empty: it has 4 vertices and no face: expected at least one face, such as f 1 2 3"
                .to_owned(),
        ),
        ("\nf 1 2 9", format!("test:6: face 1's corner 3 refers to vertex 9, but the file has only 4 vertices: {has}")),
        (
            "f 1 2 3\nf 1 0 2",
            format!("test:6: face 2's corner 2 refers to vertex 0, but vertices are counted from 1: {has}"),
        ),
        (
            "f 1 2 3\nf -5 1 2",
            format!("test:6: face 2's corner 1 refers to vertex -5, but only 4 vertices come before it: {has}"),
        ),
        (
            "f 1 2 99999999999",
            format!("test:5: face 1's corner 3 refers to vertex 99999999999, but the file has only 4 vertices: {has}"),
        ),
        ("f 1 2 /3", format!("test:5: face 1's corner 3 refers to vertex 0, but vertices are counted from 1: {has}")),
        ("f 1 2 3\nf 1 two 3", format!("test:6: face 2 cannot be understood: {corner}")),
        ("f 1 2 999999999999999999999999", format!("test:5: face 1 cannot be understood: {corner}")),
        ("f 1 2 3.0", format!("test:5: face 1 cannot be understood: {corner}")),
        ("v 1 2\nf 1 2 3", format!("test:5: vertex 5 is not a point: {point}")),
        ("v 1 two 3\nf 1 2 3", format!("test:5: vertex 5 is not a point: {point}")),
        ("v 1 2 3 0\nf 1 2 3", "test:5: vertex 5 has the weight 0: expected x y z alone".to_owned()),
        ("v 1 \\\n2\nf 1 2 3", format!("test:6: vertex 5 is not a point: {point}")),
    ] {
        assert_eq!(refused(MeshFormat::Obj, format!("{OBJ_SQUARE}{faces}\n")), expected, "{faces}");
    }
    for number in ["nan", "inf", "-inf", "1e39"] {
        let error = refused(MeshFormat::Obj, format!("{OBJ_SQUARE}v 1 {number} 3\nf 1 2 5\n"));
        assert_eq!(error, "test:5: vertex 5 is not finite: expected numbers that f32 holds, within 3.4e38");
    }
    assert_eq!(refused(MeshFormat::Obj, ""), "test: the file is empty: expected a mesh in the format OBJ");
    let error = refused(MeshFormat::Obj, b"v 0 0 0\nf 1 \xff 1\n".to_vec());
    assert_eq!(error, "test:2: the line is no text: it is not UTF-8: expected a vertex or a face");
}

#[test]
fn a_comment_behind_a_vertex_or_a_face_changes_nothing() {
    for vertex in
        ["v 0 0 0 #3", "v 0 0 0 # 3", "v 0 0 0#3 4 5", "v 0 0 0 1 # weight", "v 0 0 0 # se\u{f1}al", "v 0 0 0 #"]
    {
        let file = OBJ_SQUARE.replacen("v 0 0 0", vertex, 1);
        let mesh = read(MeshFormat::Obj, format!("{file}f 1 2 3 4 # 5\n")).unwrap();
        assert_eq!((soup(&mesh), mesh.notes.len()), (fan(), 0), "{vertex}");
    }
    let weighted = "v 0 0 0 2 # w\nv 2 0 0 2 # w\nv 2 2 1 2 # 1 2 3\nv 0 2 -5e-7 2#w\nf 1 2 3 4#5\n";
    assert_eq!(soup(&read(MeshFormat::Obj, weighted).unwrap()), fan());
    let latin_1 = [OBJ_SQUARE.as_bytes(), b"f 1 2 3 4 # se\xf1al\n"].concat();
    assert_eq!(soup(&read(MeshFormat::Obj, latin_1).unwrap()), fan());
    let coloured = "v 0 0 0 1 0 0 # red\nv 1 0 0 1 0 0 #\nv 1 1 0.5 1 0 0\nf 1 2 3\n";
    assert_eq!(colours(&read(MeshFormat::Obj, coloured).unwrap()), [RED]);
}

#[test]
fn a_comment_that_ends_in_a_backslash_is_a_line_of_its_own() {
    for file in [
        format!("# made in C:\\models\\\n{OBJ_SQUARE}f 1 2 3 4\n"),
        format!("#\\\r\n#\\\r{OBJ_SQUARE}f 1 2 3 4\n"),
        format!("{OBJ_SQUARE}# C:\\models\\\nf 1 2 3 4\n"),
        format!("{OBJ_SQUARE}g part # D:\\parts\\\nf 1 2 3 4\n"),
        format!("{OBJ_SQUARE}g D:\\parts\\\nf 1 2 3 4\n"),
        format!("{OBJ_SQUARE}o D:\\parts\\\nusemtl D:\\\nf 1 2 3 4\n"),
        format!("mtllib D:\\parts\\\n{OBJ_SQUARE}f 1 2 3 4\n# \\"),
        format!("{OBJ_SQUARE}f 1 2 3 4 # all of it \\\nl 1 2\n"),
        format!("{OBJ_SQUARE}f 1 \\\n2 \\\n3 4 # here \\\nl 1 2\n"),
        format!("{OBJ_SQUARE}g one \\\n two\nf 1 2 3 4\n"),
    ] {
        let mesh = read(MeshFormat::Obj, file.clone()).unwrap();
        assert_eq!((soup(&mesh), mesh.notes.len()), (fan(), 0), "{file}");
    }
    // The continuation of a line may be in the next piece of the file.
    for length in (1 << 17) - 30..(1 << 17) + 30 {
        let filled = format!("{}\n", "#".repeat(length));
        let file = format!("{filled}{OBJ_SQUARE}# C:\\\nf 1 2 \\\n3 4\n");
        assert_eq!(soup(&read(MeshFormat::Obj, file).unwrap()), fan(), "{length}");
    }
}

#[test]
fn faces_of_less_than_three_corners_are_skipped_with_a_note() {
    for (faces, note) in [
        ("f 1 2 3 4\nf 1 2\n", "1 face of less than three corners left out"),
        ("f 3\nf 1 2 3 4\nf\nf 1/1 2/2\n", "3 faces of less than three corners left out"),
    ] {
        let mesh = read(MeshFormat::Obj, format!("{OBJ_SQUARE}{faces}")).unwrap();
        assert_eq!((soup(&mesh), &mesh.notes[..]), (fan(), &[note.to_owned()][..]));
    }
    let error = refused(MeshFormat::Obj, format!("{OBJ_SQUARE}f 1 2\nf 1\n"));
    assert!(error.starts_with("test: the mesh is empty: each of its 2 faces has less than three corners: "), "{error}");
    // Vertices of skipped faces must exist but need not be finite.
    let mesh = read(MeshFormat::Obj, format!("{OBJ_SQUARE}v nan 0 0\nf 1 5\nf 1 2 3 4\n")).unwrap();
    assert_eq!(soup(&mesh), fan());
    let error = refused(MeshFormat::Obj, format!("{OBJ_SQUARE}f 1 9\nf 1 2 3 4\n"));
    assert!(
        error.starts_with("test:5: face 1's corner 2 refers to vertex 9, but the file has only 4 vertices"),
        "{error}"
    );
}

#[test]
fn an_empty_obj_file_says_what_it_has() {
    for (file, reason) in [
        ("v 0 0 0\nv 1 1 1\nl 1 2\n", "it has 2 vertices and no face"),
        ("# nothing\n", "it has no vertices and no faces"),
        ("hello\nworld\n", "no line begins with v or f"),
        ("v 0 0 0\ncstype bspline\nsurf 0 1 0 1 1 1 1 1\nend\n", "it has curves and surfaces in place of faces"),
    ] {
        let error = refused(MeshFormat::Obj, file);
        assert!(error.starts_with(&format!("test: the mesh is empty: {reason}")), "{error}");
    }
    let error = refused(MeshFormat::Obj, "f 1 2 3\n");
    assert!(error.starts_with("test:1: face 1's corner 1 refers to vertex 1, but the file has no vertices"), "{error}");
}

#[test]
fn a_comma_in_a_number_is_met_with_a_hint() {
    for (line, message) in [
        ("v 0,25 1,5 0,25", "vertex 5 is not a point"),
        ("v -1, 0, -1", "vertex 5 is not a point"),
        ("v 1 2 3 0,5", "vertex 5 is not a point"),
        ("f 1,000 2 3", "face 2 cannot be understood"),
    ] {
        let error = refused(MeshFormat::Obj, format!("{OBJ_SQUARE}f 1 2 3\n{line}\n"));
        assert!(error.starts_with(&format!("test:6: {message}: expected ")), "{error}");
        assert!(error.ends_with(&format!("; {COMMA}")), "{error}");
    }
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0,25 1,5 0,25\n1 0 0\n0 1 0\n3 0 1 2\n";
    let stl = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0,25 1,5 0,25\n";
    for (format, file, line) in [(MeshFormat::Ply, ply, 10), (MeshFormat::Stl, stl, 4)] {
        let error = refused(format, file);
        assert!(error.starts_with(&format!("test:{line}: ")) && error.ends_with(&format!("; {COMMA}")), "{error}");
    }
    let world = "[image]\nfile = 'a.png'\nwidth = 4\nheight = 3\n[[light]]\nposition = [0, 0, 0]\n";
    for line in ["intensity = 1,5", "colour = [0,5, 0,5, 0,5]", "colour = [0,5, 1, 1]"] {
        let error = parse_toml(format!("{world}{line}\n").as_bytes(), "a.toml", Path::new("")).unwrap_err();
        let help = error.diagnostics()[0].help.clone();
        assert_eq!(help.as_deref(), Some("the decimal mark is a point: 0.5 in place of 0,5"), "{line}");
    }
}

#[test]
fn keywords_may_be_in_capitals() {
    for libraries in ["MTLLIB m.mtl\n", "MtlLib m.mtl\n"] {
        let file = red_and_blue(libraries).replace("usemtl", "UseMtl").replace("v ", "V ").replace("f ", "F ");
        let materials = MATERIALS.replace("newmtl", "NewMtl").replace("Kd", "KD");
        let mesh = read_beside(&[("m.mtl", &materials)], &file);
        assert_eq!((soup(&mesh), colours(&mesh), mesh.notes.len()), (fan(), vec![RED, BLUE], 0));
        assert_eq!(colours(&read_beside(&[("m.mtl", &MATERIALS.replace("Kd", "kd"))], &file)), [RED, BLUE]);
    }
    assert_eq!(read(MeshFormat::Obj, format!("{OBJ_SQUARE}VN 0 0 1\nVt 0 0\nf 1 2 3\n")).unwrap().notes.len(), 1);
}

#[test]
fn materials_may_have_any_line_ends() {
    for end in ["\n", "\r\n", "\r"] {
        let materials = MATERIALS.replace('\n', end);
        let mesh = read_beside(&[("m.mtl", &materials)], red_and_blue("mtllib m.mtl\n").replace('\n', end));
        assert_eq!((colours(&mesh), mesh.notes.len()), (vec![RED, BLUE], 0), "{end:?}");
    }
}

#[test]
fn a_file_of_materials_is_found_by_what_its_line_means() {
    for (library, name) in [
        ("\"my m.mtl\"", "my m.mtl"),
        ("my m.mtl", "my m.mtl"),
        ("C:\\work\\parts\\m.mtl", "m.mtl"),
        ("\"C:\\work\\my parts\\m.mtl\"", "m.mtl"),
        ("/home/you/parts/m.mtl", "m.mtl"),
        (".\\m.mtl", "m.mtl"),
        ("m.mtl # the materials", "m.mtl"),
        ("m#1.mtl", "m#1.mtl"),
        ("caf\u{e9}.mtl", "caf\u{e9}.mtl"),
    ] {
        let mesh = read_beside(&[(name, MATERIALS)], red_and_blue(&format!("mtllib {library}\n")));
        assert_eq!((colours(&mesh), &mesh.notes), (vec![RED, BLUE], &Vec::new()), "{library}");
        assert!(mesh.libraries[0].ends_with(name), "{:?}", mesh.libraries);
    }
    // One of two file names contains a blank, the other does not.
    let red = "newmtl red\nKd 1 0 0\n";
    for library in ["\"my m.mtl\" other.mtl", "other.mtl \"my m.mtl\""] {
        let mesh = read_beside(&[("my m.mtl", red)], red_and_blue(&format!("mtllib {library}\n")));
        assert_eq!(colours(&mesh), [RED, WHITE]);
        assert!(matches!(&mesh.notes[..], [note] if note.contains("cannot be read")), "{:?}", mesh.notes);
    }
    // Both names contain blanks, or one does.
    let blue = "newmtl blue\nKd 0 0 1\n";
    for library in
        ["my m.mtl your m.MTL", "my m.mtl your m.MTL # both", "my m.mtl \"your m.MTL\"", "\"my m.mtl\" your m.MTL"]
    {
        let files = [("my m.mtl", red), ("your m.MTL", blue)];
        let mesh = read_beside(&files, red_and_blue(&format!("mtllib {library}\n")));
        assert_eq!((colours(&mesh), &mesh.notes), (vec![RED, BLUE], &Vec::new()), "{library}");
    }
    for library in ["my m.mtl n.mtl", "n.mtl my m.mtl", "n.mtl\tother.lib \"my m.mtl\""] {
        let files = [("my m.mtl", red), ("n.mtl", blue), ("other.lib", "")];
        let mesh = read_beside(&files, red_and_blue(&format!("mtllib {library}\n")));
        assert_eq!((colours(&mesh), &mesh.notes), (vec![RED, BLUE], &Vec::new()), "{library}");
    }
    // Names that differ in case are different; no file with another name is taken instead.
    let mesh = read_beside(&[("scan.mtl", MATERIALS), ("mesh.mtl", MATERIALS)], red_and_blue("mtllib Scan.MTLX\n"));
    assert_eq!(colours(&mesh), [WHITE; 2]);
    assert!(mesh.notes[0].starts_with("the materials in `Scan.MTLX` cannot be read: "), "{:?}", mesh.notes);
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_of_materials_may_have_a_name_that_is_not_utf_8() {
    use std::os::unix::ffi::OsStringExt;
    let obj = [b"mtllib caf\xe9.mtl\n", red_and_blue("").as_bytes()].concat();
    for name in [OsString::from_vec(b"caf\xe9.mtl".to_vec()), "caf\u{e9}.mtl".into()] {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(name), MATERIALS).unwrap();
        fs::write(folder.path().join("mesh.obj"), &obj).unwrap();
        let mesh = Mesh::read(&folder.path().join("mesh.obj")).unwrap();
        assert_eq!((colours(&mesh), mesh.notes.len()), (vec![RED, BLUE], 0));
    }
}

#[test]
fn a_colour_of_a_material_is_one_number_or_three() {
    let grey = [light(0.5); 3];
    for (line, colour, note) in [
        ("Kd 0.5", grey, ""),
        ("Kd 0.5 0.5 0.5 1", grey, ""),
        ("Kd\t.5 # grey", grey, ""),
        ("Kd 0.5 0.5", WHITE, "not read: colours (Kd) that are not one or three numbers from 0"),
        ("Kd 0,5 0,5 0,5", WHITE, "not read: colours (Kd) that are not one or three numbers from 0"),
        ("Kd -1 0 0", WHITE, "not read: colours (Kd) that are not one or three numbers from 0"),
        ("Kd spectral red.rfl", WHITE, "not read: colours (Kd) that are not one or three numbers from 0"),
        ("Kd 255 0 0", [light(255.0), 0.0, 0.0], "colours of materials (Kd) exceed 1, and are taken as they are"),
        ("map_Kd red.png", WHITE, "not read: textures"),
        ("K 1 0 0", WHITE, "not read: materials without a colour (Kd)"),
    ] {
        let mesh = read_beside(
            &[("m.mtl", &format!("newmtl blue\nKd 0 0 1\nnewmtl red\n{line}\n"))],
            red_and_blue("mtllib m.mtl\n"),
        );
        assert_eq!((colours(&mesh), mesh.notes.join("; ").as_str()), (vec![colour, BLUE], note), "{line}");
    }
    // Statements before the first `newmtl` belong to no material.
    let mesh = read_beside(
        &[("m.mtl", &format!("Kd 0 1 0\nnewmtl plain\n{MATERIALS}"))],
        red_and_blue("mtllib m.mtl\n").replace("blue", "plain"),
    );
    assert_eq!(colours(&mesh), [RED, WHITE]);
}

#[test]
fn a_name_of_a_material_may_have_a_number_sign_or_a_comment() {
    for (used, described) in [
        ("red", "red # as blood"),
        ("red # as blood", "red"),
        ("Material #2", "Material #2"),
        ("\"red\"", "red"),
        ("red", "\"red\""),
    ] {
        let file = red_and_blue("mtllib m.mtl\n").replace("usemtl red", &format!("usemtl {used}"));
        let materials = format!(
            "newmtl Material #1\nKd 0 1 0\n{}",
            MATERIALS.replace("newmtl red", &format!("newmtl {described}"))
        );
        let mesh = read_beside(&[("m.mtl", &materials)], file);
        assert_eq!((colours(&mesh), mesh.notes.len()), (vec![RED, BLUE], 0), "{used}, {described}");
    }
}

#[test]
fn what_is_skipped_of_an_obj_file_is_told() {
    for (lines, note) in [
        ("face 1 2 3\n", "left out: 1 line that OBJ does not know, in line 6: `face`"),
        ("hello\n1 2 3\n", "left out: 2 lines that OBJ does not know, the first in line 6: `hello`"),
        ("surf 0 1 0 1 1 1 1 1\n", "not read: curves and surfaces"),
        ("call other.obj\n", "not read: files that `call` names"),
        ("#MRGB ffff0000ffff0000\n", "not read: colours in comments (#MRGB)"),
        ("v 0 0 0 1 2\n", "not read: numbers behind the coordinates of 1 vertex, which are no colours"),
        ("v 0 0 0 0 0 -1\n", "not read: numbers behind the coordinates of 1 vertex, which are no colours"),
        ("v 0 0 0 1 0 0\nv 0 0 0 2\n", "not read: colours of vertices, since some vertices have weights"),
    ] {
        let mesh = read(MeshFormat::Obj, format!("{OBJ_SQUARE}f 1 2 3 4\n{lines}")).unwrap();
        assert_eq!((soup(&mesh), &mesh.notes[..]), (fan(), &[note.to_owned()][..]), "{lines}");
    }
}

#[test]
fn a_missing_vertex_is_told_with_the_line_that_may_have_been_it() {
    let file = OBJ_SQUARE.replacen("v 1 0 0", "v\u{a0}1 0 0", 1) + "f 1 2 3 4\n";
    let line = "line 2 begins with `v\u{a0}1`, which OBJ does not know";
    let expected = format!("test:5: face 1's corner 4 refers to vertex 4, but the file has only 3 vertices; {line}: ");
    let error = refused(MeshFormat::Obj, file);
    assert!(error.starts_with(&expected), "{error}");
}

#[test]
fn odd_corners_are_read_or_refused_as_their_numbers_say() {
    for faces in ["f 1// 2// 3// 4//", "f 1/ 2/ 3/ 4/", "f +1 +2 +3 +4", "f 1 2 3 4\nl 1 2", "fo 1 2 3 4"] {
        assert_eq!(soup(&read(MeshFormat::Obj, format!("{OBJ_SQUARE}{faces}\n")).unwrap()), fan(), "{faces}");
    }
    let repeated = read(MeshFormat::Obj, format!("{OBJ_SQUARE}f 1 2 3 4\nf 1 1 2\n")).unwrap();
    assert_eq!(repeated.triangles.len(), 3);
    for (face, message) in [
        ("f 0 1 2", "face 1's corner 1 refers to vertex 0, but vertices are counted from 1"),
        ("f 4294967297 2 3", "face 1's corner 1 refers to vertex 4294967297, but the file has only 4 vertices"),
        ("f -9 1 2", "face 1's corner 1 refers to vertex -9, but only 4 vertices come before it"),
        ("f 1.0 2.0 3.0", "face 1 cannot be understood"),
    ] {
        let error = refused(MeshFormat::Obj, format!("{OBJ_SQUARE}{face}\n"));
        assert!(error.starts_with(&format!("test:5: {message}: expected ")), "{error}");
    }
}

#[test]
fn seven_numbers_of_a_vertex_are_its_place_colour_and_opacity() {
    let vertices = "v 0 0 0 1 0 0 1\nv 1 0 0 1 0 0 1\nv 1 1 0.5 1 0 0 1\nv 0 1 -2.5e-7 1 0 0 0.5\n";
    let mesh = read(MeshFormat::Obj, format!("{vertices}f 1 2 3 4\n")).unwrap();
    assert_eq!((soup(&mesh), colours(&mesh)), (fan(), vec![RED; 2]));
}

/// A text in UTF-16, little or big endian.
fn utf_16(text: &str, is_little: bool) -> Vec<u8> {
    text.encode_utf16().flat_map(|unit| if is_little { unit.to_le_bytes() } else { unit.to_be_bytes() }).collect()
}

#[test]
fn a_file_that_is_something_else_is_named_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let lfs = "version https://git-lfs.github.com/spec/v1\noid sha256:4d4d4d4d4d4d4d4d4d4d4d4d4d4d4d\nsize 482913\n";
    let html = "\n<!DOCTYPE html>\n<html><head><title>404: Not Found</title></head><body>Not Found</body></html>\n";
    let long_html = format!("{html}{}", "<p>x</p>\n".repeat(100));
    let scene = "a.png 4 3 1 0 0 0\n";
    for (content, message) in [
        (lfs.as_bytes().to_vec(), "this is a pointer of Git LFS"),
        (html.into(), "this is a web page (HTML)"),
        (long_html.into(), "this is a web page (HTML)"),
        (utf_16(&format!("\u{feff}{OBJ_SQUARE}{scene}"), true), "this looks like UTF-16: save the file as UTF-8"),
        (utf_16(&format!("\u{feff}{OBJ_SQUARE}{scene}"), false), "this looks like UTF-16: save the file as UTF-8"),
        (utf_16(&format!("{OBJ_SQUARE}{scene}"), true), "this looks like UTF-16"),
        (utf_16(&format!("{OBJ_SQUARE}{scene}"), false), "this looks like UTF-16"),
        (b"\x1f\x8b\x08\0\0\0\0\0\0\x03".to_vec(), "this is an archive"),
    ] {
        for name in ["a.obj", "a.ply", "a.stl", "a.in", "a.toml"] {
            let path = folder.path().join(name);
            fs::write(&path, &content).unwrap();
            let error = open(&path, &rayo::internals::scene::Camera::default()).unwrap_err().render(false);
            assert!(error.contains(message) || message.split(": ").all(|part| error.contains(part)), "{name}: {error}");
            assert_eq!(error.matches("error: ").count(), 1, "{name}: {error}");
        }
        let mesh_file = folder.path().join("ok.obj");
        fs::write(&mesh_file, red_and_blue("mtllib a.mtl\n")).unwrap();
        fs::write(folder.path().join("a.mtl"), &content).unwrap();
        let notes = Mesh::read(&mesh_file).unwrap().notes;
        assert!(notes[0].starts_with(&format!("the materials in `a.mtl` cannot be read: {message}")), "{notes:?}");
    }
    // The title of a binary STL file may be any bytes.
    for title in ["version https://git-lfs.github.com/spec/v1", "<html>", "\u{feff}", "P6", "ply"] {
        let mut file = title.as_bytes().to_vec();
        file.resize(80, b' ');
        file.extend(1_u32.to_le_bytes());
        file.extend(
            [0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).as_flattened(),
        );
        file.extend([0; 2]);
        assert_eq!(read(MeshFormat::Stl, file).unwrap().triangles.len(), 1, "{title}");
    }
    assert_eq!(SceneFormat::from_path(Path::new("a.mtl")), None);
}

#[test]
fn a_mesh_under_the_name_of_another_format_is_named() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n";
    for (format, content, message) in [
        (MeshFormat::Obj, ply, "this looks like a PLY file"),
        (MeshFormat::Stl, ply, "this looks like a PLY file"),
        (MeshFormat::Obj, "solid a\nfacet normal 0 0 1\n", "this looks like an STL file"),
        (MeshFormat::Obj, "OFF\n3 1 0\n0 0 0\n", "this looks like an OFF file"),
        (MeshFormat::Obj, "glTF\u{2}\0\0\0", "this looks like a glTF file"),
        (MeshFormat::Obj, "<?xml version='1.0'?>\n<COLLADA/>", "this is XML"),
    ] {
        let error = refused(format, content);
        assert!(error.starts_with(&format!("test: {message}")), "{error}");
    }
}

#[test]
fn a_scene_without_a_byte_order_mark_may_be_utf_16_as_well() {
    let error = parse(&utf_16("a.png 4 3 1 0 0 0\n", true), "a.in").unwrap_err();
    assert_eq!(error.diagnostics().len(), 1);
    assert!(error.lines()[0].starts_with("a.in:1:1: this looks like UTF-16"), "{error}");
}
