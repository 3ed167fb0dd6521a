//! Files of atoms and points: the positions, radii and colours of the spheres made from them, and
//! the errors for invalid files.

use std::fs;

use glam::{DVec3, Vec3};
use rayo::internals::scene::{
    Camera, Cloud, CloudFormat, MeshFormat, ModelOptions, Opened, Sphere, UpAxis, open_with, srgb,
};
use tempfile::TempDir;

use crate::counting::peak_of;

const WATER: &str = "3\nwater\nO 0 0 0\nH 0.96 0 0\nH -0.24 0.93 0\n";

fn read(format: CloudFormat, source: &str) -> Cloud {
    Cloud::from_bytes(source.as_bytes(), format, None, "test").unwrap_or_else(|error| panic!("{error}: {source}"))
}

fn refused(format: CloudFormat, source: impl AsRef<[u8]>) -> String {
    Cloud::from_bytes(source.as_ref(), format, None, "test").unwrap_err().to_string()
}

/// The spheres of a file, in its own coordinates.
fn spheres(format: CloudFormat, source: &str) -> Vec<Sphere> {
    read(format, source).spheres(None)
}

fn radii(spheres: &[Sphere]) -> Vec<f32> {
    spheres.iter().map(|sphere| sphere.radius).collect()
}

/// The sRGB levels of a sphere's colour.
fn levels(sphere: &Sphere) -> [u8; 3] {
    sphere.colour.to_array().map(|linear| (srgb::encode(linear.into()) * 255.0).round() as u8)
}

/// Opens a file with this content, in a new folder, with the default options as changed by
/// `change`.
fn open(name: &str, content: impl AsRef<[u8]>, change: impl FnOnce(&mut ModelOptions)) -> Opened {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    let mut options = ModelOptions::of(Camera::default());
    change(&mut options);
    open_with(&path, &options).unwrap()
}

/// A PDB record of an atom, with its fields in their columns.
fn record(name: &str, residue: &str, [x, y, z]: [f32; 3], element: &str) -> String {
    format!("ATOM      1 {name:<4} {residue:>3} A   1    {x:8.3}{y:8.3}{z:8.3}  1.00 20.00          {element:>2}\n")
}

#[test]
fn atoms_have_the_radii_and_colours_of_their_elements() {
    let water = spheres(CloudFormat::Xyz, WATER);
    assert_eq!(radii(&water), [1.52, 1.2, 1.2]);
    assert_eq!(water[2].centre, Vec3::new(-0.24, 0.93, 0.0));
    assert_eq!((levels(&water[0]), levels(&water[1])), ([255, 13, 13], [255, 255, 255]));
    // Atomic numbers, labels, and further numbers after the coordinates.
    for lines in ["8 0 0 0\n1 1 0 0\n1 2 0 0\n", "O1 0 0 0 -0.8\nh 1 0 0 0.4\nD 2 0 0 0.4\n"] {
        assert_eq!(radii(&spheres(CloudFormat::Xyz, &format!("3\n\n{lines}"))), [1.52, 1.2, 1.2], "{lines}");
    }
    let unknown = read(CloudFormat::Xyz, "2\n\nX 0 0 0\nC 1 0 0\n");
    assert_eq!(unknown.notes, ["1 atom is of no known element: pink spheres of radius 2"]);
    assert_eq!(levels(&unknown.spheres(None)[0]), [255, 20, 147]);
}

#[test]
fn a_frame_may_name_its_columns() {
    let comment =
        "Lattice=\"5 0 0 0 5 0 0 0 5\" Properties=id:I:1:species:S:1:pos:R:3:Radius:R:1:Color:R:3 pbc=\"T T T\"";
    let named = format!("2\n{comment}\n1 Si 1 2 3 1.25 0.5 0.25 1\n2 O 4 5 6 0.75 0 0 0\n");
    let spheres = spheres(CloudFormat::Xyz, &named);
    assert_eq!((radii(&spheres), spheres[1].centre), (vec![1.25, 0.75], Vec3::new(4.0, 5.0, 6.0)));
    assert_eq!(levels(&spheres[0]), [128, 64, 255]);
    let wrong = named.replace("0.75", "-0.75");
    assert!(refused(CloudFormat::Xyz, wrong).starts_with("test:4: atom 2 cannot be understood: `2 O 4 5 6 -0.75"));
}

#[test]
fn a_frame_is_taken_by_its_number() {
    let frames = format!("{WATER}\n2\nlater\nO 0 0 5\nH 0.96 0 5\n1\nlast\nHe 0 0 9\n\n");
    let frame = |number| Cloud::from_bytes(frames.as_bytes(), CloudFormat::Xyz, number, "test");
    let heights = |number| frame(Some(number)).unwrap().centres.iter().map(|centre| centre.z).collect::<Vec<_>>();
    assert_eq!((heights(1), heights(2), heights(3)), (vec![0.0; 3], vec![5.0; 2], vec![9.0]));
    assert_eq!(frame(None).unwrap().centres.len(), 3);
    assert_eq!(frame(None).unwrap().notes.len(), 1, "there are others");
    assert_eq!(frame(Some(3)).unwrap().notes.len(), 0, "none follows");
    let message = frame(Some(4)).unwrap_err().to_string();
    assert_eq!(message, "test: there is no frame 4: the file has 3 frames: expected --frame from 1 to 3");
    let models = format!(
        "MODEL        1\n{}ENDMDL\nMODEL        2\n{}ENDMDL\n",
        record(" O", "HOH", [0.0, 0.0, 1.0], "O"),
        record(" O", "HOH", [0.0, 0.0, 2.0], "O")
    );
    let model = |number| Cloud::from_bytes(models.as_bytes(), CloudFormat::Pdb, number, "test");
    for (number, z) in [(None, 1.0), (Some(1), 1.0), (Some(2), 2.0)] {
        assert_eq!(model(number).unwrap().centres, [Vec3::new(0.0, 0.0, z)], "{number:?}");
    }
    assert!(model(Some(3)).unwrap_err().to_string().contains("no model 3: the file has 2 models"));
    assert!(model(None).unwrap().notes[0].contains("several models"));
}

#[test]
fn points_have_the_colours_behind_them_and_normals_are_none() {
    let points = |text: &str| read(CloudFormat::Xyz, text);
    let red = |text: &str| points(text).spheres(None).iter().map(|sphere| levels(sphere)[0]).collect::<Vec<_>>();
    assert_eq!(red("0 0 0 255 0 0\n1 0 0 128 0 0\n"), [255, 128]);
    assert_eq!(red("# a scan\n//X,Y,Z,R,G,B\n0,0,0,255,0,0\n1,0,0,128,0,0\n"), [255, 128]);
    assert_eq!(red("x;y;z;r;g;b\n0;0;0;0.5;0;0\n1;0;0;0.25;0;0\n"), [128, 64]);
    // An intensity followed by a colour.
    assert_eq!(red("0 0 0 77.5 255 0 0\n1 0 0 12.5 7 0 0\n"), [255, 7]);
    for no_colour in ["0 0 0\n1 0 0\n", "0 0 0 0 0 1\n1 0 0 0.6 0.8 0\n", "0 0 0 -3 5 7\n1 0 0 300 5 7\n"] {
        assert_eq!(red(no_colour), [255, 255], "{no_colour}");
    }
    assert!(points("0 0 0 0 0 1\n1 0 0 0.6 0.8 0\n").notes[0].contains("were not read"));
    let with_nan = points("0 0 0\nnan 0 1\n1 0 inf\n1 1 1\n");
    assert_eq!((with_nan.centres.len(), with_nan.is_molecule), (2, false));
    assert_eq!(with_nan.notes, ["2 points have no finite place, and are left out"]);
    // Atoms without a leading count.
    let atoms = points("C 0 0 0\nO 1.2 0 0\n");
    assert!(atoms.is_molecule);
    assert_eq!(radii(&atoms.spheres(None)), [1.7, 1.52]);
}

#[test]
fn the_digits_of_points_on_a_map_are_kept() {
    let scan = "500000.25 4100000.5 12.125\n500001.25 4100001.5 12.25\n500002.75 4100000.125 12.5\n";
    let cloud = read(CloudFormat::Xyz, scan);
    let place = |index: usize| cloud.origin + cloud.centres[index].as_dvec3();
    assert_eq!(place(0), DVec3::new(500000.25, 4100000.5, 12.125));
    assert_eq!(place(2), DVec3::new(500002.75, 4100000.125, 12.5));
    let scene = open("scan.xyz", scan, |options| options.radius = Some(0.5)).scene;
    let apart = scene.spheres[0].centre.distance(scene.spheres[1].centre);
    assert!((apart - (2.0_f32 + 0.015625).sqrt()).abs() < 1e-5, "{apart}");
}

#[test]
fn the_element_of_a_record_is_its_own_or_that_of_its_name() {
    for (name, residue, element, symbol_radius) in [
        (" CA", "GLY", "C", 1.7),
        (" CA", "GLY", "", 1.7),
        ("CA", "CA", "", 2.62),
        ("CA", "GLY", "", 1.7),
        ("1HB", "ALA", "", 1.2),
        ("HG11", "VAL", "", 1.2),
        ("SE", "MSE", "", 1.9),
        (" O5'", "A", "", 1.52),
        ("ZN", "ZN", "ZN", 2.39),
    ] {
        let line = record(name, residue, [1.0, -2.5, 3.125], element);
        let sphere = &spheres(CloudFormat::Pdb, &line)[0];
        assert_eq!((sphere.radius, sphere.centre), (symbol_radius, Vec3::new(1.0, -2.5, 3.125)), "{line}");
        // A record may end after the coordinates.
        let short = format!("{}\r\n", &line[..54]);
        assert_eq!(spheres(CloudFormat::Pdb, &short)[0].centre, sphere.centre);
    }
    let hetero = record("FE", "HEM", [0.0; 3], "").replacen("ATOM  ", "HETATM", 1);
    assert_eq!(spheres(CloudFormat::Pdb, &hetero)[0].radius, 2.44);
}

#[test]
fn atom_sites_stand_in_rows_of_any_lines() {
    let columns =
        "_atom_site.Cartn_z\n_atom_site.type_symbol\n_atom_site.Cartn_x _atom_site.Cartn_y\n_atom_site.note\n";
    let rows = "3.5 C 1 2 'it''s \"C\"'\n6 FE\n4(2) 5\n;a text\nloop_\n;\n9 O . ? x # without a place\n";
    let source = format!("data_one\n_entry.id 'loop_'\nLOOP_\n{columns}{rows}loop_\n_other.id\n1 2 3\n");
    let cloud = read(CloudFormat::Cif, &source);
    assert_eq!(cloud.notes, ["1 atoms without a place were left out"]);
    let spheres = cloud.spheres(None);
    assert_eq!(radii(&spheres), [1.7, 2.44]);
    assert_eq!(
        spheres.iter().map(|sphere| sphere.centre).collect::<Vec<_>>(),
        [Vec3::new(1.0, 2.0, 3.5), Vec3::new(4.0, 5.0, 6.0)]
    );
}

#[test]
fn fractions_of_a_cell_are_places_along_its_axes() {
    let crystal = |cell: &str, place: &str| {
        format!(
            "{cell}\nloop_\n_atom_site_label\n_atom_site_fract_x\n_atom_site_fract_y\n_atom_site_fract_z\nNa1 {place}\n"
        )
    };
    let cell = "_cell_length_a 2\n_cell_length_b 4.00(1)\n_cell_length_c 8\n_cell_angle_gamma 60\n";
    let cloud = read(CloudFormat::Cif, &crystal(cell, "0.5 0.5(1) 0.25"));
    let expected = Vec3::new(2.0, 3_f32.sqrt(), 2.0);
    assert!(cloud.centres[0].distance(expected) < 1e-6, "{:?}", cloud.centres);
    // A loop of the thermal motion may come before the atom sites.
    let motion = "loop_\n_atom_site_aniso_label\n_atom_site_aniso_U_11\nNa1 0.5\n";
    assert_eq!(read(CloudFormat::Cif, &crystal(&format!("{cell}{motion}"), "0.5 0.5 0.25")).centres.len(), 1);
    let missing = refused(CloudFormat::Cif, crystal("", "0 0 0"));
    assert!(
        missing.starts_with("test: places are fractions of a cell whose lengths and angles are missing"),
        "{missing}"
    );
    let flat = cell.replace("60", "180");
    assert!(refused(CloudFormat::Cif, crystal(&flat, "0 0 0")).contains("a cell that has a volume"));
}

#[test]
fn what_is_damaged_is_refused_with_its_place() {
    let element = "expected an element and three numbers, as in: C 0.0 1.2 -0.5";
    let pdb = record(" N", "GLY", [1.0; 3], "N");
    let mmcif = "loop_\n_atom_site.Cartn_x\n_atom_site.Cartn_y\n_atom_site.Cartn_z\n";
    for (format, source, expected) in [
        (CloudFormat::Xyz, "".into(), "the file is empty: expected atoms in the format XYZ".into()),
        (CloudFormat::Xyz, WATER.replace("0.96", "x"), format!("4: atom 2 cannot be understood: `H x 0 0`: {element}")),
        (CloudFormat::Xyz, WATER.replace("0.96", "inf"), format!("4: atom 2 has no finite place: {element}")),
        (
            CloudFormat::Xyz,
            WATER.replacen('3', "4", 1),
            "the file ends where atom 4 of a frame is expected: expected 4 atoms, as the frame's first line says"
                .into(),
        ),
        (
            CloudFormat::Xyz,
            WATER.replacen('3', "999999999999", 1),
            "1: a frame of 999999999999 atoms is announced, and the file has no room for so many: expected at most"
                .into(),
        ),
        (CloudFormat::Xyz, "0\nnothing\n".into(), "the file has no atoms: expected at least one atom".into()),
        (CloudFormat::Xyz, "hello\n".into(), "1: `hello` is neither an atom nor a point".into()),
        (CloudFormat::Xyz, "0 0 0\n\n1 0 x\n".into(), "3: point 2 cannot be understood: `1 0 x`".into()),
        (
            CloudFormat::Xyz,
            "version https://git-lfs.github.com/spec/v1\n".into(),
            "this is a pointer of Git LFS".into(),
        ),
        (CloudFormat::Pdb, pdb.replacen("1.000", "1.x00", 1), "1: atom 1's x is `1.x00`".into()),
        (CloudFormat::Pdb, format!("{pdb}ATOM\n").replace("ATOM\n", "ATOM  \n"), "2: atom 2's x is ``".into()),
        (CloudFormat::Pdb, "HEADER\n".into(), "the file has no atoms".into()),
        (CloudFormat::Cif, "data_x\n".into(), "the file has no loop of atom sites".into()),
        (CloudFormat::Cif, format!("{mmcif}1 2 3\n4 y 6\n"), "6: atom 2's y is `y`".into()),
        (CloudFormat::Cif, format!("{mmcif}1 2 3\n4 5\n"), "atom 2 has 2 of its 3 values".into()),
        (CloudFormat::Cif, format!("{mmcif}1 2 1e39\n"), "5: atom 1's z is `1e39`".into()),
    ] {
        let error = refused(format, &source);
        let (_, place) = error.split_once(':').unwrap();
        assert!(place.trim_start().starts_with(&expected), "{error} is not {expected}");
    }
}

#[test]
fn a_molecule_takes_a_small_multiple_of_its_file() {
    let mut xyz = String::from("100000\n\n");
    let mut pdb = String::new();
    for number in 0..100_000 {
        let x = f64::from(number % 100);
        xyz += &format!("C {x:.3} {:.3} 0.125\n", number / 100);
        pdb += &record(" C", "ALA", [x as f32, (number / 100) as f32, 0.125], "C");
    }
    for (format, text) in [(CloudFormat::Xyz, xyz), (CloudFormat::Pdb, pdb)] {
        let (cloud, peak) = peak_of(|| read(format, &text));
        assert_eq!(cloud.centres.len(), 100_000);
        assert!(peak < 2 * text.len(), "{format}: {peak} bytes for {}", text.len());
    }
}

#[test]
fn a_ply_file_without_faces_has_points() {
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let vertices = "0 0 0 255 0 0\n1 0 0 128 0 0\n0 nan 0 0 0 0\n";
    for faces in ["", "element face 0\nproperty list uchar int vertex_indices\n"] {
        let opened = open("points.ply", format!("{header}{faces}end_header\n{vertices}"), |_| {});
        let spheres = &opened.scene.spheres;
        assert_eq!((spheres.len(), levels(&spheres[0]), levels(&spheres[1])), (2, [255, 0, 0], [128, 0, 0]));
        assert!(opened.notes.iter().any(|note| note.contains("1 point has no finite place")), "{:?}", opened.notes);
        assert!(opened.notes.iter().any(|note| note.contains("points have no size")));
    }
    // If a radius is asked for, the vertices of a mesh become points, too.
    let mesh = rayo::internals::scene::mesh::shapes::terrain(50, 1);
    let mut file = Vec::new();
    mesh.write(MeshFormat::Ply, &mut file).unwrap();
    assert_eq!(open("mesh.ply", &file, |_| {}).scene.spheres.len(), 0);
    let points = open("mesh.ply", &file, |options| options.radius = Some(0.25));
    assert_eq!(points.scene.spheres.len(), mesh.vertices.len());
    assert!(points.scene.spheres.iter().all(|sphere| sphere.radius == 0.25) && points.scene.faces.is_empty());
}

#[test]
fn spheres_are_seen_whole_close_to_the_edge() {
    let molecule = "4\n\nCs 0 0 0\nH 9 0 0\nI 0 7 0\nC 0 0 -5\n";
    let directions = [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::new(-1.0, 2.0, 0.5)];
    for from in directions.into_iter().map(Some).chain([None]) {
        let scene = open("a.xyz", molecule, |options| options.from = from).scene;
        let grid = scene.camera.grid::<f64>();
        // The largest share of the film that a sphere reaches, computed from the tangent planes
        // through the pinhole.
        let mut reach: f64 = 0.0;
        for sphere in &scene.spheres {
            let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
            for (across, half) in [(centre.x, grid.half_width), (centre.y, grid.half_height)] {
                let angle = (across.abs() / centre.z).atan() + (radius / across.hypot(centre.z)).asin();
                reach = reach.max(angle.tan() * grid.focal / half);
            }
        }
        assert!((0.8..=0.901).contains(&reach), "{from:?}: {reach}");
    }
}

#[test]
fn axes_stand_upright_and_directions_are_the_files_own() {
    for (axis, up) in [("x", DVec3::X), ("-x", DVec3::NEG_X), ("y", DVec3::Y), ("-y", DVec3::NEG_Y)]
        .into_iter()
        .chain([("z", DVec3::Z), ("-z", DVec3::NEG_Z)])
    {
        let axis: UpAxis = axis.parse().unwrap();
        let [x, y, z] = up.to_array();
        let molecule = format!("2\n\nC 0 0 0\nH {x} {y} {z}\n");
        let scene = open("a.xyz", &molecule, |options| options.up = Some(axis)).scene;
        assert!(scene.spheres[1].centre.y > scene.spheres[0].centre.y + 0.5, "{axis}");
        // No choice of axis mirrors the model.
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|of| axis.placement().to_world().transform_vector3(of));
        assert!(x.cross(y).dot(z) < -0.99, "the world is left-handed");
    }
    // Seen from the direction of an atom, that atom is the nearest; a light from that direction is
    // on its side.
    let axes = "4\n\nC 0 0 0\nH 9 0 0\nH 0 9 0\nH 0 0 9\n";
    for (number, direction) in [(1, DVec3::X), (2, DVec3::Y), (3, DVec3::Z)] {
        let scene = open("a.xyz", axes, |options| {
            options.from = Some(direction);
            options.lights = vec![direction];
        })
        .scene;
        let depths: Vec<_> = scene.spheres.iter().map(|sphere| sphere.centre.z).collect();
        assert!(depths.iter().all(|depth| *depth >= depths[number]), "{direction}: {depths:?}");
        assert!(scene.lights[0].position.z < 0.0 && scene.lights.len() == 2, "{direction}");
    }
}

#[test]
fn lights_share_what_is_not_ambient() {
    let intensities = |lights: Vec<DVec3>, ambient| {
        let opened = open("a.xyz", WATER, |options| {
            options.lights = lights;
            options.ambient = ambient;
        });
        let carried = opened.carried_light.map(|light| opened.scene.lights[light].position);
        assert!(carried.is_none_or(|position| position == Vec3::ZERO), "{carried:?}");
        opened.scene.lights.iter().map(|light| light.intensity).collect::<Vec<_>>()
    };
    assert_eq!(intensities(vec![], None), [0.8, 0.2]);
    assert_eq!(intensities(vec![DVec3::X, DVec3::Y], Some(0.5)), [0.25, 0.25, 0.5]);
    assert_eq!(intensities(vec![DVec3::X], Some(0.0)), [1.0]);
    assert_eq!(intensities(vec![], Some(1.0)), [1.0]);
    let tinted = open("a.xyz", WATER, |options| options.colour = Vec3::new(0.5, 1.0, 0.0));
    assert_eq!(tinted.scene.spheres[1].colour, Vec3::new(0.5, 1.0, 0.0));
}
