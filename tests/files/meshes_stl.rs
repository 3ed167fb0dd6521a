//! STL files in the variants that programs write: text and binary files and how they are told
//! apart, and files with too much or too little content.

use rayo::internals::scene::MeshFormat;

use crate::meshes::{STL_STEPS, fan, read, refused, soup, stl_binary, stl_text};

/// The notes on reading a file that contains the two facets.
fn notes(source: impl Into<Vec<u8>>) -> Vec<String> {
    let source = source.into();
    let shown = source.escape_ascii().to_string();
    let mesh = read(MeshFormat::Stl, source).unwrap_or_else(|error| panic!("{error}: {shown}"));
    assert_eq!(soup(&mesh), fan(), "{shown}");
    mesh.notes
}

#[test]
fn the_words_of_a_text_are_of_any_case_and_any_lines() {
    let text = stl_text(" square");
    for source in [
        text.to_uppercase(),
        text.replacen("solid", "Solid", 1),
        format!(" \t{text}"),
        format!("\r\n\n{text}"),
        format!("\u{feff} {text}"),
        format!("\u{feff}{}", text.to_uppercase()),
        text.replace('\n', "\r"),
        text.replace('\n', "\n\r\n"),
        text.replace("endloop", "end loop").replace("endfacet", "END facet").replace("endsolid", "end solid"),
        text.replacen("solid square", "solid", 1),
        text.replacen("solid square", "solidsquare", 1),
        text.replacen("solid square\n", "", 1),
        format!("# made by hand\n{text}"),
        text.replace("outer loop", "outer loop # of three\n  # a comment"),
        text.replace("0 0 1", "-nan(ind) 0"),
        text.replace(" normal 0 0 1", ""),
        text.replacen("solid square", "solid \u{e9}t\u{e9}\t\u{1}", 1),
        text.replacen("solid square", &format!("solid {}", "x".repeat(3000)), 1),
    ] {
        assert!(notes(source.clone()).is_empty(), "{source}");
    }
    let cr = text.replace("vertex 1 0 0e0", "vertex 1 0").replace('\n', "\r");
    assert_eq!(refused(MeshFormat::Stl, cr), format!("test:5: facet 1 cannot be understood: {STL_STEPS}"));
}

#[test]
fn the_lines_of_a_text_may_be_one() {
    let text = stl_text(" part of a vertex");
    let one_line = text.replace('\n', " ");
    assert!(notes(one_line.clone()).is_empty());
    assert!(notes(one_line.to_uppercase()).is_empty());
    for name in ["", " a facet", " vertex", " endloop"] {
        assert!(notes(stl_text(name).replace('\n', " ")).is_empty(), "{name}");
        assert!(notes(stl_text(name).replace("loop\n", "loop ").replace("facet\n", "facet ")).is_empty(), "{name}");
    }
    let short = refused(MeshFormat::Stl, one_line.replacen("vertex 1 0 0e0", "vertex 1 0", 1));
    assert_eq!(short, format!("test:1: facet 1 cannot be understood: {STL_STEPS}"));
}

#[test]
fn a_facet_of_more_than_three_vertices_is_cut_into_triangles() {
    let [a, b, c, d] = ["0 0 0", "1 0 0", "1 1 0.5", "0 1 -2.5e-7"];
    let square =
        format!("facet normal 0 0 1\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nvertex {d}\nendloop\nendfacet\n");
    let text = |facets: &str| format!("solid polygons\n{facets}endsolid polygons\n");
    for source in [text(&square), text(&square).replace('\n', " ")] {
        let mesh = read(MeshFormat::Stl, source).unwrap();
        assert_eq!((soup(&mesh), mesh.polygons), (fan(), 1));
    }
    let squares = read(MeshFormat::Stl, text(&square.repeat(2))).unwrap();
    assert_eq!((soup(&squares), squares.polygons), (fan().repeat(2), 2));
    // A fourth corner inside the triangle of the other three.
    let arrow = read(MeshFormat::Stl, text(&square.replace(c, "0.25 0.25 0").replace(d, "0 1 0"))).unwrap();
    let area = |[a, b, c]: [[f32; 3]; 3]| ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0;
    assert_eq!(soup(&arrow).into_iter().map(area).sum::<f32>(), 0.25);
    let facet = format!("test:10: facet 2 cannot be understood: {STL_STEPS}");
    assert_eq!(refused(MeshFormat::Stl, text(&format!("{square}vertex {a}\n"))), facet);
    let short = square.replace(&format!("vertex {d}\n"), "").replace(&format!("vertex {c}\n"), "");
    assert_eq!(refused(MeshFormat::Stl, text(&short)), format!("test:6: facet 1 cannot be understood: {STL_STEPS}"));
}

#[test]
fn solids_may_be_empty_or_begin_and_end_twice() {
    let text = stl_text(" x");
    let empty = "solid e\nendsolid e\n";
    assert!(notes(format!("{empty}{text}{empty}{empty}")).is_empty());
    assert!(notes(format!("solid x\n{text}endsolid x\n")).is_empty());
}

#[test]
fn a_text_without_its_end_is_told() {
    let text = stl_text(" x");
    let told = ["the file ends after 2 whole facets, without endsolid: it may be cut off"];
    assert_eq!(notes(text.replace("endsolid x\n", "")), told);
    assert_eq!(notes(format!("{text}solid y\n")), told);
    let cut = &text[..text.len() - "  endfacet\nendsolid x\n".len()];
    assert_eq!(refused(MeshFormat::Stl, cut), format!("test: the file ends in facet 2: {STL_STEPS}"));
    assert_eq!(refused(MeshFormat::Stl, "solid x\n"), "test: the mesh is empty: expected at least one face");
}

#[test]
fn binary_stl_may_be_longer_than_its_facets() {
    let goes_on = "the file goes on after the facets that its header counts: what follows was not read";
    let attributes = "not read: attributes of facets, which some programs use for colours";
    for title in ["part", "solid part", "SOLID", "solid", "facet", "\u{feff}solid"] {
        for more in [&b"\0"[..], b"\n", &[0; 92], &[b' '; 50]] {
            let longer = [&stl_binary(title)[..], more].concat();
            assert_eq!(notes(longer), [goes_on, attributes], "{title} {more:?}");
        }
        assert_eq!(notes(stl_binary(title)), [attributes], "{title}");
    }
    // The same if the title looks like the lines of a text file.
    assert_eq!(notes([&stl_binary("solid\nfacet normal")[..], b"\n"].concat()), [goes_on, attributes]);
}

#[test]
fn a_count_that_was_never_filled_in_is_told() {
    let with_count = |count: u32| {
        let mut file = stl_binary("part");
        file[80..84].copy_from_slice(&count.to_le_bytes());
        file
    };
    assert_eq!(notes(with_count(0))[0], "the header counts 0 facets, but 2 follow, which were read");
    let odd = refused(MeshFormat::Stl, [&with_count(0)[..], b"odd"].concat());
    let expected = "expected the number of facets, of 50 bytes each";
    assert_eq!(odd, format!("test: the header counts 0 facets, but 103 bytes follow it: {expected}"));
    for claimed in [3, u32::MAX] {
        let error = refused(MeshFormat::Stl, with_count(claimed));
        let claim = format!("test: the header claims {claimed} facets, and the file has no room for so many");
        assert_eq!(error, format!("{claim}: expected at most 2: 100 bytes follow it"));
    }
    assert_eq!(refused(MeshFormat::Stl, [0; 84]), "test: the mesh is empty: expected at least one face");
}

#[test]
fn a_text_that_is_no_mesh_is_said_to_be_one() {
    let page = format!("\n  Not found: {}\n", "the part that you are looking for ".repeat(4));
    let error = refused(MeshFormat::Stl, page);
    let expected = "expected the word solid at the start of a text, or a binary file";
    assert!(
        error.starts_with("test: this is no STL file: it is a text that begins with `Not found: the part "),
        "{error}"
    );
    assert!(error.ends_with(expected), "{error}");
}
