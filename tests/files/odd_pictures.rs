//! Unusual pictures from other programs: they are either read as intended, or the error says what
//! they are.

use rayo::internals::render::{ImageError, ImageFile};
use rayo::{Picture, Pixels};
use std::io::Cursor;
use std::path::Path;

fn read(bytes: &[u8]) -> Result<Picture, ImageError> {
    ImageFile::of_bytes(Path::new("a"), bytes.to_vec()).and_then(|file| {
        let size = file.size();
        let picture = file.read()?;
        assert_eq!((picture.width, picture.height), size, "the size is known before the pixels");
        Ok(picture)
    })
}

/// The levels of a valid picture.
#[track_caller]
fn levels(bytes: &[u8]) -> Vec<[u8; 3]> {
    match read(bytes).unwrap().pixels {
        Pixels::Rgb8(levels) => levels,
        Pixels::Rgb32F(_) => panic!("floats"),
    }
}

/// The floats of a valid picture.
#[track_caller]
fn floats(bytes: &[u8]) -> Vec<[f32; 3]> {
    match read(bytes).unwrap().pixels {
        Pixels::Rgb32F(floats) => floats,
        Pixels::Rgb8(_) => panic!("levels"),
    }
}

/// Asserts that a valid file is not supported, with this explanation.
#[track_caller]
fn is_of_another_kind(bytes: &[u8], what: &str) {
    let error = read(bytes).unwrap_err();
    assert!(matches!(error, ImageError::OtherKind { .. }), "{error}");
    let expected = format!("a is of a kind that is not read here: {what}; convert it to PNG or PFM first");
    assert_eq!(error.to_string(), expected);
}

/// Asserts that a file is damaged, with this explanation.
#[track_caller]
fn is_damaged(bytes: &[u8], what: &str) {
    let error = read(bytes).unwrap_err();
    assert!(matches!(error, ImageError::Malformed { .. }), "{error}");
    assert_eq!(error.to_string(), format!("a is damaged or incomplete: {what}"));
}

/// A picture of three by two pixels, stored in Exif's eight orientations: the letters of each row
/// as they are in the file.
const UPRIGHT: &str = "abc def";
const STORED: [&str; 8] = [UPRIGHT, "cba fed", "fed cba", "def abc", "ad be cf", "cf be ad", "fc eb da", "da eb fc"];

/// Pixels given as letters in rows: their bytes, and the numbers of rows and columns.
fn stored(rows: &str) -> (Vec<u8>, usize, usize) {
    let letters = rows.bytes().filter(|letter| *letter != b' ').map(|letter| letter - b'a').collect();
    let rows: Vec<_> = rows.split(' ').collect();
    (letters, rows.len(), rows[0].len())
}

#[test]
fn a_tiff_in_any_of_the_eight_orientations_is_turned() {
    use tiff::encoder::{TiffEncoder, colortype};
    for (order, rows) in (1_u16..).zip(STORED) {
        let (letters, rows, columns) = stored(rows);
        let pixels: Vec<_> = letters.iter().flat_map(|letter| [*letter, 7 * letter, 200]).collect();
        let (mut of_levels, mut of_floats) = (Cursor::new(Vec::new()), Cursor::new(Vec::new()));
        let mut encoder = TiffEncoder::new(&mut of_levels).unwrap();
        let mut image = encoder.new_image::<colortype::RGB8>(columns as u32, rows as u32).unwrap();
        image.encoder().write_tag(tiff::tags::Tag::Orientation, order).unwrap();
        image.write_data(&pixels).unwrap();
        let mut encoder = TiffEncoder::new(&mut of_floats).unwrap();
        let mut image = encoder.new_image::<colortype::RGB32Float>(columns as u32, rows as u32).unwrap();
        image.encoder().write_tag(tiff::tags::Tag::Orientation, order).unwrap();
        image.write_data(&pixels.iter().map(|value| f32::from(*value)).collect::<Vec<_>>()).unwrap();
        let upright: Vec<_> = (0..6).map(|letter| [letter, 7 * letter, 200]).collect();
        let of_levels = read(&of_levels.into_inner()).unwrap();
        assert_eq!(of_levels, Picture::new(3, 2, Pixels::Rgb8(upright.clone())), "order {order}");
        let upright = upright.iter().map(|pixel| pixel.map(f32::from)).collect();
        let of_floats = read(&of_floats.into_inner()).unwrap();
        assert_eq!(of_floats, Picture::new(3, 2, Pixels::Rgb32F(upright)), "order {order}");
    }
}

/// An HDR with these header lines, this size line, and pixels with the same byte in all three
/// channels and an exponent for which the byte is the value.
fn hdr(lines: &str, size: &str, pixels: &[u8]) -> Vec<u8> {
    let pixels = pixels.iter().flat_map(|value| [*value, *value, *value, 136]);
    format!("{lines}\n\n{size}\n").into_bytes().into_iter().chain(pixels).collect()
}

#[test]
fn an_hdr_in_any_of_the_eight_orders_is_turned() {
    // The axis and direction of the rows, and of the columns.
    let orders = [
        ("-Y", "+X"),
        ("-Y", "-X"),
        ("+Y", "-X"),
        ("+Y", "+X"),
        ("+X", "-Y"),
        ("-X", "-Y"),
        ("-X", "+Y"),
        ("+X", "+Y"),
    ];
    for ((down, across), rows) in orders.into_iter().zip(STORED) {
        let (letters, rows, columns) = stored(rows);
        // Small values would be taken for run-length codes.
        let values: Vec<_> = letters.iter().map(|letter| letter + 100).collect();
        let size = format!("{down} {rows} {across} {columns}");
        let picture = read(&hdr("#?RADIANCE\nFORMAT=32-bit_rle_rgbe", &size, &values)).unwrap();
        let upright = (100_u8..106).map(|value| [f32::from(value); 3]).collect();
        assert_eq!(picture, Picture::new(3, 2, Pixels::Rgb32F(upright)), "{size}");
    }
}

#[test]
fn headers_of_hdr_that_programs_write_are_read() {
    let size = "-Y 1 +X 2";
    for lines in [
        "#?RADIANCE",
        "#?RADIANCE\nFORMAT=32-bit_rle_rgbe",
        "#?RGBE\nFORMAT=32-bit_rle_rgbe",
        "#?RADIANCE\n# FORMAT=none, EXPOSURE=2\nFORMAT=32-bit_rle_rgbe",
        "#?RADIANCE\npfilt -1\nVIEW= -vtv\nPRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329\nFORMAT = 32-bit_rle_rgbe ",
    ] {
        assert_eq!(floats(&hdr(lines, size, &[40, 80])), [[40.0; 3], [80.0; 3]], "{lines}");
        let text = format!("{lines}\n\n{size}\n").replace('\n', "\r\n");
        let with_cr_lf = [text.as_bytes(), &[40, 40, 40, 136, 80, 80, 80, 136]].concat();
        assert_eq!(floats(&with_cr_lf), [[40.0; 3], [80.0; 3]], "{lines}");
    }
}

#[test]
fn values_of_an_hdr_are_divided_by_what_they_were_multiplied_by() {
    let exposed = hdr("#?RADIANCE\nEXPOSURE=2\nEXPOSURE= 4.0", "-Y 1 +X 2", &[40, 80]);
    assert_eq!(floats(&exposed), [[5.0; 3], [10.0; 3]]);
    let corrected = hdr("#?RADIANCE\nCOLORCORR=1 2 0.5\nEXPOSURE=2", "-Y 1 +X 1", &[40]);
    assert_eq!(floats(&corrected), [[20.0, 10.0, 40.0]]);
}

#[test]
fn an_hdr_that_is_not_read_is_named_for_what_it_is() {
    let xyz = hdr("#?RADIANCE\nFORMAT=32-bit_rle_xyze", "-Y 1 +X 1", &[40]);
    is_of_another_kind(&xyz, "its colours are XYZ and not RGB");
    is_of_another_kind(&hdr("#?RADIANCE\nFORMAT=raw", "-Y 1 +X 1", &[40]), "its format is \"raw\"");
    is_damaged(&hdr("#?RADIANCE\nEXPOSURE=0", "-Y 1 +X 1", &[40]), "its EXPOSURE is \"0\"");
    is_damaged(&hdr("#?RADIANCE\nCOLORCORR=1 1", "-Y 1 +X 1", &[40]), "its COLORCORR is \"1 1\"");
    for size in ["-Y 1", "-Y 1 -Y 1", "-Z 1 +X 1", "-Y one +X 1", "-Y 1 +X 4294967295"] {
        is_damaged(&hdr("#?RADIANCE", size, &[40]), &format!("its size is \"{size}\""));
    }
    is_damaged(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "it ends too early");
    let claims = "it claims 2147483648x2147483648 pixels, which it cannot hold";
    is_damaged(&hdr("#?RADIANCE", "-Y 2147483648 +X 2147483648", &[40]), claims);
}

#[test]
fn a_pfm_with_two_characters_to_a_line_end_is_not_shifted() {
    let row = [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0].map(f32::to_le_bytes);
    let expected = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    for header in
        ["PF\r\n2 1\r\n-1.0\r\n", "PF\r\n2\r\n1\r\n-1.0\r\n", "PF\n2 1\n-1.0\n", "PF 2 1 -1.0 ", "PF\n\n2 1\n-1.0\r"]
    {
        assert_eq!(floats(&[header.as_bytes(), row.as_flattened()].concat()), expected, "{header:?}");
    }
    // The first byte of the first value is the same as a line feed.
    let low_byte = f32::from_le_bytes([b'\n', 0, 0x80, 0x3f]);
    let row = [low_byte; 3].map(f32::to_le_bytes);
    for header in ["PF\n1 1\n-1.0\n", "PF\n\n1 1\n-1.0\n", "PF\r\n1 1\r\n-1.0\r\n", "PF\n1 1\n-1.0\r"] {
        assert_eq!(floats(&[header.as_bytes(), row.as_flattened()].concat()), [[low_byte; 3]], "{header:?}");
    }
}

#[test]
fn a_pfm_of_four_channels_is_named() {
    let row = [1.0_f32; 4].map(f32::to_le_bytes);
    is_of_another_kind(&[b"PF4\n1 1\n-1.0\n", row.as_flattened()].concat(), "it has a fourth channel (PF4)");
    is_damaged(&[b"Pfm\n1 1\n-1.0\n", row.as_flattened()].concat(), "it begins with \"Pfm\"");
}

#[test]
fn every_portable_map_of_up_to_8_bits_is_read() {
    const BITS: [[u8; 3]; 3] = [[0; 3], [255; 3], [0; 3]];
    for bits in [&b"P1\n3 1\n1 0 1\n"[..], b"P1 3 1 101", b"P1\n# a\n3 1\n1 # b\n01", b"P4\n3 1\n\xbf"] {
        assert_eq!(levels(bits), BITS, "{}", bits.escape_ascii());
    }
    const GREY: [[u8; 3]; 2] = [[0; 3], [170; 3]];
    for grey in [
        &b"P2 2 1 3 0 2"[..],
        b"P2\n2 1\n3\n0 # a comment\n#another 9 9\n2\n",
        b"P2\r\n2 1\r\n3\r\n0 2\r\n",
        b"P5\n#a\n2 #b\n1\n#c\n3\n\0\x02",
        b"P7\nWIDTH 2\nHEIGHT 1\nDEPTH 1\nMAXVAL 3\nTUPLTYPE GRAYSCALE\nENDHDR\n\0\x02",
        b"P7\nWIDTH 2\n# any order\nMAXVAL 3\nDEPTH 1\nHEIGHT 1\nENDHDR\n\0\x02",
        b"P7\nWIDTH 2\nHEIGHT 1\nDEPTH 2\nMAXVAL 3\nTUPLTYPE GRAYSCALE_ALPHA\nENDHDR\n\0\x03\x02\x03",
    ] {
        assert_eq!(levels(grey), GREY, "{}", grey.escape_ascii());
    }
    const COLOURS: [[u8; 3]; 2] = [[17, 34, 51], [0, 255, 128]];
    for colours in [
        &b"P3 2 1 255 17 34 51 0 255 128"[..],
        b"P6 2 1 255\n\x11\x22\x33\x00\xff\x80",
        b"P7\nWIDTH 2\nHEIGHT 1\nDEPTH 3\nMAXVAL 255\nTUPLTYPE RGB\nENDHDR\n\x11\x22\x33\x00\xff\x80",
        b"P7\nWIDTH 2\nHEIGHT 1\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n\x11\x22\x33\xff\x00\xff\x80\xff",
    ] {
        assert_eq!(levels(colours), COLOURS, "{}", colours.escape_ascii());
    }
    let black_and_white = b"P7\nWIDTH 2\nHEIGHT 1\nDEPTH 1\nMAXVAL 1\nTUPLTYPE BLACKANDWHITE\nENDHDR\n\0\x01";
    assert_eq!(levels(black_and_white), [[0; 3], [255; 3]]);
}

#[test]
fn samples_below_255_are_scaled_to_the_nearest_level() {
    for largest in 1..=254_u32 {
        let samples: Vec<_> = (0..=largest as u8).collect();
        let expected = samples.iter().map(|sample| {
            // Half a level is rounded up.
            let level = (f64::from(*sample) * 255.0 / f64::from(largest) + 0.5).floor();
            [level as u8; 3]
        });
        let bytes = [format!("P5\n{} 1\n{largest}\n", largest + 1).as_bytes(), &samples].concat();
        assert_eq!(levels(&bytes), expected.collect::<Vec<_>>(), "{largest}");
    }
}

#[test]
fn a_sample_above_the_largest_is_told() {
    for bytes in [
        &b"P5\n2 1\n15\n\x03\x14"[..],
        b"P2\n2 1\n15\n3 20\n",
        b"P7\nWIDTH 2\nHEIGHT 1\nDEPTH 1\nMAXVAL 15\nENDHDR\n\x03\x14",
    ] {
        is_damaged(bytes, "a sample is 20, and its largest is 15");
    }
    let black_and_white = b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 1\nMAXVAL 1\nTUPLTYPE BLACKANDWHITE\nENDHDR\n\x02";
    is_damaged(black_and_white, "a sample is 2, and its largest is 1");
    for bytes in
        [&b"P2 1 1 4095 9"[..], b"P5 1 1 65535 \x01\x01", b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 1\nMAXVAL 256\nENDHDR\n\0\x09"]
    {
        let error = read(bytes).unwrap_err();
        assert!(matches!(error, ImageError::Unsupported { what: "more than 8 bits per channel", .. }), "{error}");
    }
}

#[test]
fn a_qoi_of_three_channels_may_have_codes_with_alpha() {
    let file = |channels: u8, codes: &[u8]| {
        let header = [&b"qoif\0\0\0\x03\0\0\0\x01"[..], &[channels, 0]].concat();
        [&header[..], codes, &[0, 0, 0, 0, 0, 0, 0, 1]].concat()
    };
    // A colour with alpha, one without, and the first again by its hash, which depends on alpha.
    let hash = (10 * 3 + 20 * 5 + 30 * 7 + 128 * 11) % 64;
    let codes = [0xff, 10, 20, 30, 128, 0xfe, 1, 2, 3, hash as u8];
    assert_eq!(levels(&file(3, &codes)), [[10, 20, 30], [1, 2, 3], [10, 20, 30]]);
    let error = read(&file(4, &codes)).unwrap_err();
    assert!(matches!(error, ImageError::Unsupported { what: "transparency", .. }), "{error}");
    let opaque = [0xfe, 10, 20, 30, 0xfe, 1, 2, 3, 0xc0];
    for channels in [3, 4] {
        let file = file(channels, &opaque);
        assert_eq!(levels(&file), [[10, 20, 30], [1, 2, 3], [1, 2, 3]]);
        assert_eq!(levels(&[&file[..], b"behind the end"].concat()), [[10, 20, 30], [1, 2, 3], [1, 2, 3]]);
        is_damaged(&file[..file.len() - 8], "it ends too early");
        is_damaged(&file[..file.len() - 12], "it ends too early");
    }
    is_damaged(&file(5, &opaque), "invalid number of channels: 5");
}

/// An EXR with one part that has these channels, a data window of this position and width, and this
/// display window.
fn exr(channels: &[(&str, exr::prelude::FlatSamples)], data: (i32, i32, usize), display: (usize, usize)) -> Vec<u8> {
    use exr::prelude::*;
    let channels = channels.iter().map(|(name, samples)| AnyChannel::new(*name, samples.clone())).collect();
    let channels = AnyChannels::sort(channels);
    let size = Vec2(data.2, channels.list[0].sample_data.len() / data.2);
    let mut image = Image::from_channels(size, channels);
    image.layer_data.attributes.layer_position = Vec2(data.0, data.1);
    image.attributes.display_window = IntegerBounds::from_dimensions(display);
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// The values of one channel.
fn channel(values: &[f32]) -> exr::prelude::FlatSamples {
    exr::prelude::FlatSamples::F32(values.to_vec())
}

#[test]
fn grey_of_an_exr_is_all_three_colours() {
    use exr::prelude::{FlatSamples, f16};
    let whole = (0, 0, 2);
    assert_eq!(floats(&exr(&[("Y", channel(&[0.5, 3.0]))], whole, (2, 1))), [[0.5; 3], [3.0; 3]]);
    let halves = FlatSamples::F16([0.5, 3.0].map(f16::from_f32).to_vec());
    assert_eq!(floats(&exr(&[("Y", halves)], whole, (2, 1))), [[0.5; 3], [3.0; 3]]);
    let opaque = [("A", channel(&[1.0, 1.0])), ("Y", channel(&[0.5, 3.0]))];
    assert_eq!(floats(&exr(&opaque, whole, (2, 1))), [[0.5; 3], [3.0; 3]]);
    let transparent = [("A", channel(&[1.0, 0.5])), ("Y", channel(&[0.5, 3.0]))];
    let error = read(&exr(&transparent, whole, (2, 1))).unwrap_err();
    assert!(matches!(error, ImageError::Unsupported { what: "transparency", .. }), "{error}");
    // R, G and B are preferred; other channels are ignored.
    let names = ["B", "G", "R", "Y", "Z", "albedo.R"];
    let all: Vec<_> = names.iter().zip(1_u8..).map(|(name, value)| (*name, channel(&[f32::from(value); 2]))).collect();
    assert_eq!(floats(&exr(&all, whole, (2, 1))), [[3.0, 2.0, 1.0]; 2]);
}

#[test]
fn an_exr_without_colours_that_are_shown_names_its_channels() {
    let what = "and what is shown here is R, G and B, or Y without RY and BY";
    for (names, listed) in [
        (&["rgb.R", "rgb.G", "rgb.B"][..], "rgb.B, rgb.G, rgb.R"),
        (&[".R", ".G", ".B"], ".B, .G, .R"),
        (&["Y", "RY", "BY"], "BY, RY, Y"),
        (&["Z"], "Z"),
    ] {
        let channels: Vec<_> = names.iter().map(|name| (*name, channel(&[0.5; 2]))).collect();
        let expected = format!("it has the channels {listed}, {what}");
        is_of_another_kind(&exr(&channels, (0, 0, 2), (2, 1)), &expected);
    }
}

#[test]
fn an_exr_is_black_outside_of_its_data_window() {
    let values: Vec<_> = (1_u8..=4).map(f32::from).collect();
    let grey = [("Y", channel(&values))];
    // The display window is larger than a file of this size could hold.
    let (width, height) = (600, 500);
    for (x, y, seen) in [(0, 0, 4), (599, 499, 1), (-1, -1, 1), (298, -1, 2), (-7, 3, 0), (700, 900, 0)] {
        let picture = read(&exr(&grey, (x, y, 2), (width, height))).unwrap();
        assert_eq!((picture.width, picture.height), (600, 500));
        let Pixels::Rgb32F(pixels) = &picture.pixels else { panic!("floats") };
        for (value, (dx, dy)) in values.iter().zip([(0, 0), (1, 0), (0, 1), (1, 1)]) {
            let (x, y) = (x + dx, y + dy);
            if (0..600).contains(&x) && (0..500).contains(&y) {
                assert_eq!(pixels[y as usize * width + x as usize], [*value; 3]);
            }
        }
        let lit = pixels.iter().filter(|pixel| **pixel != [0.0; 3]).count();
        assert_eq!(lit, seen, "data at {x}, {y}");
    }
    let error = read(&exr(&grey, (0, 0, 2), (100_000, 100_000))).unwrap_err();
    assert!(matches!(error, ImageError::TooLarge { .. }), "{error}");
}

/// A TIFF of levels with these tags.
fn tiff(size: (u32, u32), tags: &[(u16, &[u16])], data: &[u8]) -> Vec<u8> {
    use tiff::encoder::TiffEncoder;
    use tiff::tags::Tag;
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    let mut directory = encoder.image_directory().unwrap();
    let is_tiled = tags.iter().any(|(tag, _)| Tag::from_u16_exhaustive(*tag) == Tag::TileWidth);
    directory.write_tag(Tag::ImageWidth, size.0).unwrap();
    directory.write_tag(Tag::ImageLength, size.1).unwrap();
    for (tag, values) in tags {
        directory.write_tag(Tag::from_u16_exhaustive(*tag), *values).unwrap();
    }
    let at = directory.write_data(data).unwrap() as u32;
    if is_tiled {
        let offsets: Vec<_> = (0..data.len() as u32).step_by(256).map(|tile| at + tile).collect();
        directory.write_tag(Tag::TileByteCounts, &vec![256_u32; offsets.len()][..]).unwrap();
        directory.write_tag(Tag::TileOffsets, &offsets[..]).unwrap();
    } else {
        directory.write_tag(Tag::StripOffsets, at).unwrap();
        directory.write_tag(Tag::StripByteCounts, data.len() as u32).unwrap();
    }
    directory.finish().unwrap();
    bytes.into_inner()
}

/// Tags of TIFF.
const BITS: u16 = 258;
const PHOTOMETRIC: u16 = 262;
const SAMPLES: u16 = 277;
const COMPRESSION: u16 = 259;
const FILL_ORDER: u16 = 266;
const PLANAR: u16 = 284;
const PREDICTOR: u16 = 317;
const TILE_WIDTH: u16 = 322;
const TILE_LENGTH: u16 = 323;

#[test]
fn a_predictor_of_a_tiff_without_compression_has_no_effect() {
    let grey = &[(BITS, &[8][..]), (COMPRESSION, &[1]), (PHOTOMETRIC, &[1]), (PREDICTOR, &[2])];
    assert_eq!(levels(&tiff((3, 1), grey, &[10; 3])), [[10; 3]; 3]);
}

#[test]
fn a_tiff_of_bits_in_reverse_order_is_named() {
    let bilevel = &[(BITS, &[1][..]), (COMPRESSION, &[1]), (PHOTOMETRIC, &[1]), (FILL_ORDER, &[2])];
    is_of_another_kind(&tiff((8, 1), bilevel, &[1]), "the bits of its bytes are in reverse order (FillOrder 2)");
}

#[test]
fn layouts_of_tiff_are_read_or_named() {
    let rgb: &[(u16, &[u16])] = &[(BITS, &[8; 3]), (PHOTOMETRIC, &[2]), (SAMPLES, &[3])];
    let expected = [[1, 2, 3], [4, 5, 6]];
    assert_eq!(levels(&tiff((2, 1), rgb, &[1, 2, 3, 4, 5, 6])), expected);
    let planes = [rgb, &[(PLANAR, &[2])]].concat();
    // A strip holds a single plane: a file with one strip for all planes is damaged.
    assert!(read(&tiff((2, 1), &planes, &[1, 4, 2, 5, 3, 6])).is_err());
    // With this tag, 0 is white.
    let grey = |photometric: &'static [u16]| tiff((2, 1), &[(BITS, &[8]), (PHOTOMETRIC, photometric)], &[0, 200]);
    assert_eq!(levels(&grey(&[1])), [[0; 3], [200; 3]]);
    assert_eq!(levels(&grey(&[0])), [[255; 3], [55; 3]]);
    // Tiles that extend beyond the picture.
    let tiles: &[(u16, &[u16])] = &[(TILE_WIDTH, &[16]), (TILE_LENGTH, &[16])];
    let grey_tiles = [tiles, &[(BITS, &[8]), (PHOTOMETRIC, &[1])]].concat();
    let tile = |first: u8| (0..=255).map(move |at| if at == 0 { first } else { 9 });
    let data: Vec<_> = (1..=4).flat_map(tile).collect();
    let pixels = levels(&tiff((30, 28), &grey_tiles, &data));
    assert_eq!((corners_of(&pixels), pixels[1]), ([[1; 3], [2; 3], [3; 3], [4; 3]], [9; 3]));
    let tiles_in_planes = [tiles, &planes].concat();
    let data: Vec<_> = (1..=12).flat_map(tile).collect();
    let pixels = levels(&tiff((30, 28), &tiles_in_planes, &data));
    assert_eq!(corners_of(&pixels), [[1, 5, 9], [2, 6, 10], [3, 7, 11], [4, 8, 12]]);
    assert_eq!(pixels[1], [9; 3]);
}

/// The first pixel of each 16 x 16 tile in a picture of 30 x 28.
fn corners_of(pixels: &[[u8; 3]]) -> [[u8; 3]; 4] {
    [0, 16, 16 * 30, 16 * 30 + 16].map(|at| pixels[at])
}

#[test]
fn a_tiff_that_is_not_read_is_named_for_what_it_is() {
    let palette: &[(u16, &[u16])] = &[(BITS, &[8]), (PHOTOMETRIC, &[3]), (320, &[0x7fff; 768])];
    is_of_another_kind(&tiff((2, 1), palette, &[0, 1]), "its colours are in a palette");
    let four_bits: &[(u16, &[u16])] = &[(BITS, &[4]), (PHOTOMETRIC, &[1])];
    is_of_another_kind(&tiff((2, 1), four_bits, &[0x12]), "its samples are grey, in whole numbers of 4 bits");
    let with_alpha: &[(u16, &[u16])] = &[(BITS, &[8; 2]), (PHOTOMETRIC, &[1]), (SAMPLES, &[2]), (338, &[2])];
    is_of_another_kind(
        &tiff((1, 1), with_alpha, &[1, 255]),
        "its samples are grey and 1 more, in whole numbers of 8 bits",
    );
    // Integers are not floats, whether the tag says so or is missing.
    for format in [&[][..], &[(339, &[1, 1, 1][..])]] {
        let numbers = [&[(BITS, &[32; 3][..]), (PHOTOMETRIC, &[2]), (SAMPLES, &[3])], format].concat();
        is_of_another_kind(&tiff((1, 1), &numbers, &[0; 12]), "its samples are RGB, in whole numbers of 32 bits");
    }
    let beside: &[(u16, &[u16])] = &[(BITS, &[8; 4]), (PHOTOMETRIC, &[2]), (SAMPLES, &[4]), (338, &[0])];
    assert_eq!(levels(&tiff((1, 1), beside, &[1, 2, 3, 9])), [[1, 2, 3]]);
    let what = "it has samples beside its colours, in tiles or with a predictor";
    is_of_another_kind(
        &tiff((1, 1), &[beside, &[(COMPRESSION, &[5]), (PREDICTOR, &[2])]].concat(), &[1, 2, 3, 9]),
        what,
    );
    let tiles: &[(u16, &[u16])] = &[(TILE_WIDTH, &[16]), (TILE_LENGTH, &[16])];
    is_of_another_kind(&tiff((1, 1), &[beside, tiles].concat(), &[9; 256]), what);
    let jpeg: &[(u16, &[u16])] = &[(BITS, &[8]), (PHOTOMETRIC, &[1]), (COMPRESSION, &[7])];
    is_of_another_kind(&tiff((1, 1), jpeg, &[0]), "compression by JPEG");
    for method in [2, 3] {
        let fax: &[(u16, &[u16])] = &[(BITS, &[1]), (PHOTOMETRIC, &[0]), (COMPRESSION, &[method])];
        is_of_another_kind(&tiff((8, 1), fax, &[0]), "compression by CCITT group 3, of faxes (group 4 is read)");
    }
    let zstd: &[(u16, &[u16])] = &[(BITS, &[8]), (PHOTOMETRIC, &[1]), (COMPRESSION, &[50_000])];
    is_of_another_kind(&tiff((1, 1), zstd, &[0]), "compression by method 50000");
}

/// A little-endian TIFF whose entries have one 32-bit value each; `data` is at offset 8, before the
/// directory. The file ends with the directory, without its last four bytes (the offset of the next
/// directory), which the caller adds.
fn tiff_without_end(entries: &[(u16, u32)], data: &[u8]) -> Vec<u8> {
    let mut file = [&b"II*\0"[..], &(8 + data.len() as u32).to_le_bytes(), data].concat();
    file.extend((entries.len() as u16).to_le_bytes());
    for (tag, value) in entries {
        file.extend([tag.to_le_bytes(), 4_u16.to_le_bytes()].as_flattened());
        file.extend([1, *value].map(u32::to_le_bytes).as_flattened());
    }
    file
}

#[test]
fn a_tiff_may_end_with_its_directory() {
    let entries = [(256, 2), (257, 1), (258, 8), (262, 1), (273, 8), (279, 2)];
    let file = tiff_without_end(&entries, &[7, 9]);
    for more in [0, 1, 3, 4] {
        assert_eq!(levels(&[&file[..], &[0; 4][..more]].concat()), [[7; 3], [9; 3]], "{more} bytes");
    }
    is_damaged(&file[..file.len() - 1], "it ends too early");
}

#[test]
fn a_strip_of_all_rows_may_be_said_to_have_the_most_rows() {
    // Two rows compressed as a fax: eight white pixels and eight black ones.
    let fax = [0x93, 0x51, 0x40, 0x04, 0x00, 0x40];
    for rows in [2, (1 << 31) - 1, u32::MAX] {
        let grey = [(256, 2), (257, 2), (258, 8), (262, 1), (273, 8), (278, rows), (279, 4)];
        let file = [tiff_without_end(&grey, &[1, 2, 3, 4]), vec![0; 4]].concat();
        assert_eq!(levels(&file), [[1; 3], [2; 3], [3; 3], [4; 3]], "{rows}");
        let entries = [(256, 8), (257, 2), (258, 1), (259, 4), (262, 0), (273, 8), (278, rows), (279, 6)];
        let file = [tiff_without_end(&entries, &fax), vec![0; 4]].concat();
        assert_eq!(levels(&file), [[[255; 3]; 8], [[0; 3]; 8]].concat(), "{rows}");
    }
}

#[test]
fn the_length_of_the_only_strip_may_be_missing() {
    let grey = |count| [(256, 2), (257, 2), (258, 8), (262, 1), (273, 8), (278, 2), (279, count)];
    let file = [tiff_without_end(&grey(0), &[1, 2, 3, 4]), vec![0; 4]].concat();
    assert_eq!(levels(&file), [[1; 3], [2; 3], [3; 3], [4; 3]]);
    let fax = [0x93, 0x51, 0x40, 0x04, 0x00, 0x40];
    let entries = [(256, 8), (257, 2), (258, 1), (259, 4), (262, 0), (273, 8), (278, 2), (279, 0)];
    let file = [tiff_without_end(&entries, &fax), vec![0; 4]].concat();
    assert_eq!(levels(&file), [[[255; 3]; 8], [[0; 3]; 8]].concat());
}

#[test]
fn lzw_in_its_first_form_is_named() {
    // The codes 256, 7, 9 and 257, of 9 bits each, in both bit orders.
    let entries = [(256, 2), (257, 1), (258, 8), (259, 5), (262, 1), (273, 8), (278, 1), (279, 5)];
    let file = |codes: &[u8]| [tiff_without_end(&entries, codes), vec![0; 4]].concat();
    assert_eq!(levels(&file(&[0x80, 0x01, 0xc1, 0x30, 0x10])), [[7; 3], [9; 3]]);
    is_of_another_kind(&file(&[0x00, 0x0f, 0x24, 0x08, 0x08]), "compression by LZW in the form of before TIFF 5");
}

#[test]
fn tiles_in_lzw_are_read_in_planes_too() {
    use tiff::encoder::compression::{CompressionAlgorithm, Lzw};
    let mut rng = rayo::internals::scene::Rng::new(1);
    let tiles: Vec<Vec<u8>> = (0..12).map(|_| (0..256).map(|_| (rng.next_u64() % 4) as u8 * 60).collect()).collect();
    let (mut data, mut offsets, mut lengths) = (Vec::new(), Vec::new(), Vec::new());
    for tile in &tiles {
        offsets.push(8 + data.len() as u32);
        Lzw.write_to(&mut data, tile).unwrap();
        lengths.push(8 + data.len() as u32 - offsets.last().unwrap());
    }
    let bits = 8 + data.len() as u32;
    data.extend([8_u16, 0, 8, 0, 8, 0].map(u16::to_le_bytes).as_flattened());
    let lists = 8 + data.len() as u32;
    data.extend([offsets, lengths].concat().iter().flat_map(|number| number.to_le_bytes()));
    let entries = [
        (256, 30),
        (257, 28),
        (258, bits),
        (259, 5),
        (262, 2),
        (277, 3),
        (284, 2),
        (322, 16),
        (323, 16),
        (324, lists),
        (325, lists + 48),
    ];
    let mut file = tiff_without_end(&entries, &data);
    // The count of entries with lists is greater than one.
    let directory = 10 + data.len();
    for (entry, count) in [(2, 3_u32), (9, 12), (10, 12)] {
        file[directory + 12 * entry + 4..][..4].copy_from_slice(&count.to_le_bytes());
    }
    let expected = |x: usize, y: usize| [0, 4, 8].map(|plane| tiles[plane + y / 16 * 2 + x / 16][y % 16 * 16 + x % 16]);
    let expected: Vec<_> = (0..28).flat_map(|y| (0..30).map(move |x| expected(x, y))).collect();
    assert_eq!(levels(&file), expected);
}

/// The chunks of a PNG with one pixel.
fn png_chunks() -> Vec<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&[1, 2, 3]).unwrap();
    let (mut chunks, mut rest) = (Vec::new(), &bytes[8..]);
    while let Some((length, _)) = rest.split_first_chunk() {
        let (chunk, after) = rest.split_at(12 + u32::from_be_bytes(*length) as usize);
        chunks.push(chunk.to_vec());
        rest = after;
    }
    chunks
}

/// A chunk of a PNG, with its checksum.
fn chunk(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let mut crc = flate2::Crc::new();
    crc.update(name);
    crc.update(content);
    [&(content.len() as u32).to_be_bytes()[..], name, content, &crc.sum().to_be_bytes()].concat()
}

#[test]
fn what_is_beside_the_pixels_of_a_png_is_passed_over() {
    let [header, pixels, end] = &png_chunks()[..] else { panic!("three chunks") };
    let png = |chunks: &[&[u8]]| [b"\x89PNG\r\n\x1a\n", chunks.concat().as_slice()].concat();
    let mut wrong_sum = chunk(b"tEXt", b"Title\0a");
    *wrong_sum.last_mut().unwrap() ^= 1;
    for beside in [
        wrong_sum,
        chunk(b"xyZz", b"of another program"),
        chunk(b"gAMA", &45_455_u32.to_be_bytes()),
        chunk(b"sRGB", &[0]),
        chunk(b"iCCP", b"x\0\0no profile"),
        chunk(b"tIME", &[7, 234, 1, 1, 0, 0, 0]),
    ] {
        assert_eq!(levels(&png(&[header, &beside, pixels, end])), [[1, 2, 3]], "{}", beside.escape_ascii());
        assert_eq!(levels(&png(&[header, pixels, &beside, end])), [[1, 2, 3]], "{}", beside.escape_ascii());
    }
    assert_eq!(levels(&png(&[header, pixels, end, b"behind the end"])), [[1, 2, 3]]);
}

#[test]
fn a_png_may_lack_its_last_chunk_but_no_part_of_another() {
    let [header, pixels, end] = &png_chunks()[..] else { panic!("three chunks") };
    let whole = [b"\x89PNG\r\n\x1a\n", &header[..], pixels, end].concat();
    let without_end = &whole[..whole.len() - end.len()];
    assert_eq!(levels(without_end), [[1, 2, 3]]);
    assert_eq!(levels(&[without_end, &chunk(b"tEXt", b"Title\0a")].concat()), [[1, 2, 3]]);
    for cut in [&whole[..20], &whole[..whole.len() - end.len() - 1], &without_end[..without_end.len() - 6]] {
        is_damaged(cut, "it ends too early");
    }
    is_damaged(&whole[..8 + header.len()], "it ends too early");
}

#[test]
fn a_png_with_a_wrong_checksum_of_its_pixels_is_damaged() {
    let [header, pixels, end] = &png_chunks()[..] else { panic!("three chunks") };
    let png = |pixels: &[u8]| [b"\x89PNG\r\n\x1a\n", &header[..], pixels, end].concat();
    assert_eq!(levels(&png(pixels)), [[1, 2, 3]]);
    // The chunk's own checksum is correct.
    let mut stream = pixels[8..pixels.len() - 4].to_vec();
    *stream.last_mut().unwrap() ^= 1;
    let what = "its compressed pixels are corrupt, or do not have the checksum that follows them";
    is_damaged(&png(&chunk(b"IDAT", &stream)), what);
}

#[test]
fn a_png_changed_for_iphones_is_named() {
    let chunks = png_chunks().concat();
    let png = |first: &[u8]| [b"\x89PNG\r\n\x1a\n", first, &chunks].concat();
    let what = "it is a PNG that was changed for iPhones (CgBI)";
    is_of_another_kind(&png(&chunk(b"CgBI", &[0x50, 0, 0x20, 6])), what);
    is_damaged(&png(&chunk(b"IDAT", &[])), "IDAT chunk appeared before IHDR chunk");
}
