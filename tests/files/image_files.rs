//! Image files: written in bands, atomically, and read back; files that are read are not trusted.

use proptest::prelude::*;
use rayo::internals::render::{
    Engine, Format, Frame, ImageError, ImageFile, ImageWriter, OutputError, Settings, read, render,
};
use rayo::internals::scene::{Scene, many};
use rayo::{Picture, Pixels};
use std::fs;
use std::io::Read;
use std::path::Path;
use tempfile::TempDir;

const FORMATS: [(&str, Format); 8] = [
    ("a.exr", Format::Exr),
    ("a.hdr", Format::Hdr),
    ("a.pfm", Format::Pfm),
    ("a.pgm", Format::PpmText),
    ("a.png", Format::Png),
    ("a.ppm", Format::Ppm),
    ("a.qoi", Format::Qoi),
    ("a.tiff", Format::Tiff),
];

/// Levels that include every byte value.
fn levels(width: u32, height: u32) -> Vec<[u8; 3]> {
    (0..width * height).map(|i| [i as u8, (i / 3) as u8, (i * 7 + 1) as u8]).collect()
}

/// Floats below 0, above 1, and inexact in decimal.
fn floats(width: u32, height: u32) -> Vec<[f32; 3]> {
    (0..width * height).map(|i| [i as f32 / 7.0 - 3.0, -(i as f32), 1e-40 * i as f32]).collect()
}

/// The picture that reading a file back must give.
fn expected(format: Format, width: u32, height: u32) -> Picture {
    let pixels = if format.is_8bit() {
        Pixels::Rgb8(levels(width, height))
    } else {
        let rounded = |pixel| if format == Format::Hdr { rgbe(pixel) } else { pixel };
        Pixels::Rgb32F(floats(width, height).into_iter().map(rounded).collect())
    };
    Picture::new(width, height, pixels)
}

/// A pixel as Radiance HDR stores it: 8 bits per channel with a common exponent, rounded down.
fn rgbe(pixel: [f32; 3]) -> [f32; 3] {
    let pixel = pixel.map(|value| value.clamp(0.0, 255.0 * 2.0_f32.powi(119)));
    let largest = pixel.into_iter().fold(0.0, f32::max);
    if largest < f32::MIN_POSITIVE {
        return [0.0; 3];
    }
    let mut unit = 2.0_f64.powi(f64::from(largest).log2().floor() as i32 + 1 - 8);
    unit *= if f64::from(largest) / unit >= 255.5 { 2.0 } else { 1.0 };
    pixel.map(|value| ((f64::from(value) / unit).round() * unit) as f32)
}

/// Writes all rows, `band` rows per call.
fn write_rows(
    writer: &mut ImageWriter,
    format: Format,
    (width, height): (u32, u32),
    band: u32,
) -> Result<(), ImageError> {
    let band = (band * width) as usize;
    if format.is_8bit() {
        levels(width, height).chunks(band).try_for_each(|rows| writer.write_rgb8(rows))
    } else {
        floats(width, height).chunks(band).try_for_each(|rows| writer.write_f32x3(rows))
    }
}

fn write(path: &Path, format: Format, (width, height): (u32, u32), band: u32) -> Result<(), ImageError> {
    let mut writer = ImageWriter::create(path, format, width, height)?;
    write_rows(&mut writer, format, (width, height), band)?;
    writer.finish()
}

/// The names in a directory, sorted.
fn names(directory: &TempDir) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(directory.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The result of reading a file with these bytes.
fn read_bytes(bytes: &[u8]) -> Result<Picture, ImageError> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("image");
    fs::write(&path, bytes).unwrap();
    read(&path)
}

#[test]
fn the_extension_tells_the_format_in_any_case() {
    for (name, format) in FORMATS {
        assert_eq!(Format::from_path(Path::new(name)).unwrap(), format);
        assert_eq!(Format::from_path(Path::new(&name.to_uppercase())).unwrap(), format);
    }
    for name in ["picture", "png", ".png"] {
        assert_eq!(Format::from_path(Path::new(name)).unwrap(), Format::Png, "a name without extension");
    }
    for name in ["picture.jpg", "a.png.", "a.p"] {
        let error = Format::from_path(Path::new(name)).unwrap_err().to_string();
        assert!(error.contains(".png, .ppm, .pgm, .pfm, .exr, .hdr, .tiff, .tif or .qoi"), "{error}");
    }
}

#[test]
fn values_beyond_the_range_of_hdr_are_its_largest_and_black() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.hdr");
    let mut writer = ImageWriter::create(&path, Format::Hdr, 2, 3).unwrap();
    let (inf, tiny) = (f32::INFINITY, 1e-40);
    let rows = [
        [inf, 1.0, 0.0],
        [tiny; 3],
        [-inf, -1.0, 0.0],
        [f32::NAN, 0.5, 0.25],
        [1.5e38, 0.0, 0.0],
        [1023.99994, 2.0, 517.0],
    ];
    writer.write_f32x3(&rows).unwrap();
    writer.finish().unwrap();
    let Pixels::Rgb32F(pixels) = read(&path).unwrap().pixels else { panic!("floats") };
    assert_eq!(pixels[0][0], 255.0 * 2f32.powi(119));
    assert_eq!(pixels[1..4], [[0.0; 3], [0.0; 3], [0.0, 0.5, 0.25]]);
    assert_eq!(pixels[4..], [rgbe([1.5e38, 0.0, 0.0]), [1024.0, 0.0, 520.0]]);
}

#[test]
fn too_large_a_picture_for_a_whole_format_is_refused_first() {
    let directory = tempfile::tempdir().unwrap();
    for (name, format) in FORMATS {
        let path = directory.path().join(name);
        let needed = match format {
            Format::Tiff | Format::Qoi => "takes 1144 MiB of memory",
            Format::Hdr => "takes 4577 MiB of memory",
            _ => {
                assert!(ImageWriter::create(&path, format, 20_000, 20_000).is_ok(), "{name}");
                continue;
            }
        };
        let error = ImageWriter::create(&path, format, 20_000, 20_000).err().unwrap();
        assert!(matches!(error, ImageError::Whole { .. }), "{error}");
        let error = error.to_string();
        let instead = "name it .png, .ppm, .exr or .pfm, which are written row by row";
        assert!(error.contains(needed) && error.ends_with(instead), "{error}");
    }
    assert_eq!(names(&directory), [""; 0]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_png_has_its_pixels_however_it_is_cut_into_bands(
        width in 1_u32..400, height in 1_u32..200, band in 1_u32..40, seed in any::<u32>(), zeros in 0_u32..32,
        strips in 1_u32..4,
    ) {
        let directory = tempfile::tempdir().unwrap();
        // Several strips, some of a single row.
        let width = if width % 9 == 0 { width << 10 } else { width };
        let height = if width > 400 { height % 4 * strips + 1 } else { height * strips };
        // Noise, smooth values, or long runs of black; and rows unlike any row before.
        let noise = |i: u32| (i.wrapping_mul(seed | 1) ^ seed).wrapping_mul(0x9e37_79b9) >> 24;
        let value = |i: u32| if noise(i / 97) % 32 < zeros { 0 } else if i % 1024 < 300 { i / 50 } else { noise(i) };
        let pixels: Vec<_> = (0..width * height).map(|i| [value(i), value(3 * i), value(i / 2)].map(|v| v as u8)).collect();
        let [whole, cut] = [height, band].map(|rows| {
            let path = directory.path().join("a.png");
            let mut writer = ImageWriter::create(&path, Format::Png, width, height).unwrap();
            pixels.chunks((rows * width) as usize).for_each(|rows| writer.write_rgb8(rows).unwrap());
            writer.finish().unwrap();
            (fs::read(&path).unwrap(), read(&path).unwrap())
        });
        prop_assert!(whole == cut);
        // The checksum of the stream, which not every decoder verifies.
        let mut stream = Vec::new();
        flate2::read::ZlibDecoder::new(&pixels_of(&whole.0)[..]).read_to_end(&mut stream).unwrap();
        prop_assert_eq!(stream.len(), (3 * width as usize + 1) * height as usize);
        let most = 6 * pixels.len() + 4096;
        prop_assert!(whole.0.len() < most);
        prop_assert!(cut.1 == Picture::new(width, height, Pixels::Rgb8(pixels)));
    }
}

/// A picture of 2x2 pixels whose files are compared with literal bytes.
const TINY: [[u8; 3]; 4] = [[255, 0, 9], [10, 99, 100], [0, 0, 0], [1, 2, 3]];

fn bytes_of_tiny(format: Format) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("tiny");
    let mut writer = ImageWriter::create(&path, format, 2, 2).unwrap();
    writer.write_rgb8(&TINY).unwrap();
    writer.finish().unwrap();
    fs::read(&path).unwrap()
}

#[test]
fn plain_files_have_these_bytes() {
    assert_eq!(bytes_of_tiny(Format::Ppm), b"P6\n2 2\n255\n\xff\x00\x09\x0a\x63\x64\x00\x00\x00\x01\x02\x03");
    assert_eq!(bytes_of_tiny(Format::PpmText), b"P3\n2 2\n255\n255 0 9\n10 99 100\n0 0 0\n1 2 3\n");
    // PFM stores its rows from the bottom up, in little endian.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("tiny.pfm");
    let mut writer = ImageWriter::create(&path, Format::Pfm, 1, 2).unwrap();
    writer.write_f32x3(&[[1.0, -2.0, 0.5]]).unwrap();
    writer.write_f32x3(&[[f32::INFINITY, 0.0, -0.0]]).unwrap();
    writer.finish().unwrap();
    let rows = b"\x00\x00\x80\x7f\x00\x00\x00\x00\x00\x00\x00\x80\x00\x00\x80\x3f\x00\x00\x00\xc0\x00\x00\x00\x3f";
    assert_eq!(fs::read(&path).unwrap(), [&b"PF\n1 2\n-1.0\n"[..], rows].concat());
}

#[test]
fn qoi_is_marked_linear_and_one_colour_tiff_is_small() {
    // The last byte of the header: 0 would mean sRGB, and this is 1, linear.
    assert_eq!(bytes_of_tiny(Format::Qoi)[..14], *b"qoif\0\0\0\x02\0\0\0\x02\x03\x01");
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.tiff");
    let mut writer = ImageWriter::create(&path, Format::Tiff, 400, 300).unwrap();
    writer.write_rgb8(&[[3, 200, 77]; 400 * 300]).unwrap();
    writer.finish().unwrap();
    assert!(fs::metadata(&path).unwrap().len() < 36_000);
}

/// The chunks of a PNG: names and contents.
fn chunks(png: &[u8]) -> Vec<(&str, &[u8])> {
    let (mut chunks, mut rest) = (Vec::new(), &png[8..]);
    while let Some((length, after)) = rest.split_first_chunk() {
        let (content, end) = after[4..].split_at(u32::from_be_bytes(*length) as usize);
        chunks.push((str::from_utf8(&after[..4]).unwrap(), content));
        rest = &end[4..];
    }
    chunks
}

/// The content of the IDAT chunks.
fn pixels_of(png: &[u8]) -> Vec<u8> {
    chunks(png).into_iter().filter(|(name, _)| *name == "IDAT").flat_map(|(_, content)| content).copied().collect()
}

#[test]
fn a_png_has_no_chunks_but_the_necessary_ones() {
    let bytes = bytes_of_tiny(Format::Png);
    let mut names: Vec<_> = chunks(&bytes).into_iter().map(|(name, _)| name).collect();
    names.dedup();
    assert_eq!(names, ["IHDR", "IDAT", "IEND"]);
}

#[test]
fn dropped_or_unfinished_writer_keeps_the_old_file() {
    let directory = tempfile::tempdir().unwrap();
    for (name, format) in FORMATS {
        let path = directory.path().join(name);
        // After some rows, and after all rows.
        for rows in [4, 8] {
            let mut writer = ImageWriter::create(&path, format, 8, 8).unwrap();
            write_rows(&mut writer, format, (8, rows), 1).unwrap();
            drop(writer);
            assert_eq!(names(&directory), [""; 0], "{name}");
        }
        fs::write(&path, "old").unwrap();
        let mut writer = ImageWriter::create(&path, format, 8, 8).unwrap();
        write_rows(&mut writer, format, (8, 5), 5).unwrap();
        let error = writer.finish().unwrap_err();
        assert!(matches!(error, ImageError::RowsMissing { rows: 5, height: 8, .. }), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        fs::remove_file(&path).unwrap();
        assert_eq!(names(&directory), [""; 0], "{name}");
    }
}

#[test]
fn file_that_appears_during_the_work_is_kept() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.ppm");
    let mut writer = ImageWriter::create_new(&path, Format::Ppm, 4, 4).unwrap();
    write_rows(&mut writer, Format::Ppm, (4, 4), 4).unwrap();
    fs::write(&path, "faster").unwrap();
    let error = writer.finish().unwrap_err();
    assert!(matches!(error, ImageError::Output(OutputError::Exists { .. })), "{error}");
    assert_eq!(fs::read(&path).unwrap(), b"faster");
    assert_eq!(names(&directory), ["a.ppm"]);
}

#[test]
fn a_write_protected_file_is_not_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    fs::write(&path, "precious").unwrap();
    let mut permissions = fs::metadata(&path).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&path, permissions).unwrap();
    let error = ImageWriter::create(&path, Format::Png, 1, 1).err().unwrap();
    assert!(matches!(error, ImageError::Output(OutputError::ReadOnly { .. })), "{error}");
}

#[test]
fn an_image_without_pixels_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    for (width, height) in [(0, 1), (1, 0), (0, 0)] {
        let error = ImageWriter::create(&directory.path().join("a.png"), Format::Png, width, height).err().unwrap();
        assert!(matches!(error, ImageError::NoPixels { .. }), "{error}");
    }
}

#[test]
fn wrong_pixels_for_a_writer_are_told() {
    type Write = fn(&mut ImageWriter) -> Result<(), ImageError>;
    let mistakes: [(&str, Write, &str); 4] = [
        ("a.pfm", |writer| writer.write_rgb8(&[[0; 3]; 2]), "takes floats"),
        ("a.png", |writer| writer.write_f32x3(&[[0.0; 3]; 2]), "takes 8 bits"),
        ("a.png", |writer| writer.write_rgb8(&[[0; 3]; 3]), "no whole rows"),
        ("a.png", |writer| writer.write_rgb8(&[[0; 3]; 6]), "2 are left"),
    ];
    for (name, write, message) in mistakes {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(name);
        let mut writer = ImageWriter::create(&path, Format::from_path(&path).unwrap(), 2, 2).unwrap();
        let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| write(&mut writer))).unwrap_err();
        let told = panic.downcast_ref::<String>().map_or("", |told| told);
        assert!(told.contains(message), "{told}");
    }
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
    use std::process::Command;

    #[test]
    fn dangling_link_gets_its_file_unless_it_must_be_new() {
        let directory = tempfile::tempdir().unwrap();
        let link = directory.path().join("link.ppm");
        symlink("target.ppm", &link).unwrap();
        let error = ImageWriter::create_new(&link, Format::Ppm, 4, 4).err().unwrap();
        assert!(matches!(error, ImageError::Output(OutputError::Exists { .. })), "{error}");
        write(&link, Format::Ppm, (4, 4), 4).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(names(&directory), ["link.ppm", "target.ppm"]);
    }

    #[test]
    fn a_loop_of_links_is_an_error() {
        let directory = tempfile::tempdir().unwrap();
        symlink("b.ppm", directory.path().join("a.ppm")).unwrap();
        symlink("a.ppm", directory.path().join("b.ppm")).unwrap();
        let error = ImageWriter::create(&directory.path().join("a.ppm"), Format::Ppm, 1, 1).err().unwrap();
        assert!(matches!(error, ImageError::Output(OutputError::Write { .. })), "{error}");
    }

    #[test]
    fn the_null_device_takes_every_format_and_stays_a_device() {
        for (_, format) in FORMATS {
            write(Path::new("/dev/null"), format, (64, 64), 7).unwrap();
        }
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_in_every_format_and_at_every_size() {
        for (_, format) in FORMATS {
            // A picture so small that nothing reaches the disk before the end, and one that is
            // large enough.
            for size in [(1, 1), (300, 300)] {
                let error = write(Path::new("/dev/full"), format, size, 1).unwrap_err().to_string();
                assert!(error.contains("/dev/full") && error.contains("free some space"), "{format:?}: {error}");
            }
        }
    }

    #[test]
    fn a_fifo_receives_every_format_and_can_be_read_from() {
        let directory = tempfile::tempdir().unwrap();
        let fifo = directory.path().join("fifo");
        assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        for (name, format) in FORMATS {
            let picture = std::thread::scope(|scope| {
                let reader = scope.spawn(|| read(&fifo));
                write(&fifo, format, (40, 30), 7).unwrap();
                reader.join().unwrap().unwrap()
            });
            assert!(picture == expected(format, 40, 30), "{name}");
        }
        assert_eq!(names(&directory), ["fifo"]);
        assert!(fs::metadata(&fifo).unwrap().file_type().is_fifo());
    }

    #[test]
    fn a_picture_does_not_run_as_the_owner_of_the_file_it_replaces() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        for special in [0o4000, 0o2000, 0o1000, 0o7000] {
            fs::write(&path, "old").unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(special | 0o711)).unwrap();
            assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o7777, special | 0o711);
            write(&path, Format::Png, (1, 1), 1).unwrap();
            assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o7777, 0o711, "{special:o}");
        }
    }

    #[test]
    fn the_file_has_the_permissions_of_any_new_file() {
        let directory = tempfile::tempdir().unwrap();
        // A file created in the ordinary way shows this process's umask.
        fs::write(directory.path().join("plain"), "").unwrap();
        let mode = |name: &str| fs::metadata(directory.path().join(name)).unwrap().permissions().mode() & 0o7777;
        write(&directory.path().join("a.png"), Format::Png, (1, 1), 1).unwrap();
        assert_eq!(mode("a.png"), mode("plain"));
    }
}

#[test]
fn grey_becomes_three_equal_channels() {
    let grey = |pixels: &[u8]| Pixels::Rgb8(pixels.iter().map(|&level| [level; 3]).collect());
    assert_eq!(read_bytes(b"P2\n2 1\n255\n7 200\n").unwrap().pixels, grey(&[7, 200]));
    assert_eq!(read_bytes(b"P5\n2 1\n255\n\x07\xc8").unwrap().pixels, grey(&[7, 200]));
    assert_eq!(
        read_bytes(&png(png::ColorType::Grayscale, png::BitDepth::Eight, &[7, 200])).unwrap().pixels,
        grey(&[7, 200])
    );
    let pfm = read_bytes(b"Pf\n1 2\n1.0\n\x3f\x80\x00\x00\x40\x00\x00\x00").unwrap();
    assert_eq!(pfm, Picture::new(1, 2, Pixels::Rgb32F(vec![[2.0; 3], [1.0; 3]])));
}

/// A PNG with one row of two pixels.
fn png(color: png::ColorType, depth: png::BitDepth, row: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(row).unwrap();
    bytes
}

#[test]
fn opaque_alpha_is_dropped_and_transparency_is_refused() {
    use png::{BitDepth::Eight, ColorType::*};
    let expected = Pixels::Rgb8(vec![[1, 2, 3], [4, 5, 6]]);
    assert_eq!(read_bytes(&png(Rgba, Eight, &[1, 2, 3, 255, 4, 5, 6, 255])).unwrap().pixels, expected);
    let expected = Pixels::Rgb8(vec![[1; 3], [4; 3]]);
    assert_eq!(read_bytes(&png(GrayscaleAlpha, Eight, &[1, 255, 4, 255])).unwrap().pixels, expected);
    for bytes in [png(Rgba, Eight, &[1, 2, 3, 255, 4, 5, 6, 254]), png(GrayscaleAlpha, Eight, &[1, 0, 4, 255])] {
        let error = read_bytes(&bytes).unwrap_err();
        assert!(matches!(error, ImageError::Unsupported { what: "transparency", .. }), "{error}");
    }
}

#[test]
fn sixteen_bits_are_refused() {
    for bytes in [
        png(png::ColorType::Rgb, png::BitDepth::Sixteen, &[1; 12]),
        png(png::ColorType::Grayscale, png::BitDepth::Sixteen, &[1; 4]),
        b"P3\n1 1\n65535\n1 2 3\n".to_vec(),
        b"P6\n1 1\n1000\n\0\x01\0\x02\0\x03".to_vec(),
    ] {
        let error = read_bytes(&bytes).unwrap_err();
        assert!(matches!(error, ImageError::Unsupported { .. }), "{error}");
    }
}

#[test]
fn a_header_that_promises_too_much_is_an_error() {
    let mut huge_png = png(png::ColorType::Rgb, png::BitDepth::Eight, &[0; 6]);
    huge_png[16..24].copy_from_slice(&[0x3b, 0x9a, 0xca, 0x00, 0x3b, 0x9a, 0xca, 0x00]);
    // The header's checksum is right, so that the size is what is rejected.
    let sum = crc(&huge_png[12..29]);
    huge_png[29..33].copy_from_slice(&sum);
    for bytes in [
        &b"P3\n1000000000 1000000000\n255\n1 2 3\n"[..],
        b"P6\n1000000000 1000000000\n255\n123",
        b"P6\n4294967295 4294967295\n255\n123",
        b"P6\n100000 100000\n255\n123",
        b"P5\n4294967295 1\n255\n123",
        b"PF\n1000000000 1000000000\n-1.0\n123456789012",
        b"PF\n4294967295 1\n-1.0\n123456789012",
        &huge_png,
    ] {
        let error = read_bytes(bytes).unwrap_err();
        assert!(matches!(error, ImageError::Malformed { .. }), "{error}");
    }
}

/// The checksum of a PNG chunk.
fn crc(bytes: &[u8]) -> [u8; 4] {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum().to_be_bytes()
}

#[test]
fn nonsense_is_an_error() {
    for bytes in [&b"P"[..], b"P8\n1 1\n\0", b"GIF89a", b"\x89PNG\r\n", b"\0\0\0\0"] {
        let error = read_bytes(bytes).unwrap_err();
        assert!(matches!(error, ImageError::NotAnImage { .. }), "{error}");
    }
    for bytes in [
        &b""[..],
        b"P6\n0 5\n255\n",
        b"P4\n9 1\n\0",
        b"P7\n",
        b"P6\n1 1\n0\n123",
        b"P6\n-1 1\n255\n123",
        b"P6\n1",
        b"P3\n1 1\n255\n1 2 256\n",
        b"P3\n1 1\n255\n1 2 x\n",
        b"PF\n0 0\n-1.0\n",
        b"PF\n1 1\n0\n123456789012",
        b"PF\n1 1\nnan\n123456789012",
        b"PF\n1 1\nminus one\n123456789012",
        b"PF\n1.5 1\n-1\n123456789012",
        b"PFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF",
        b"\x89PNG\r\n\x1a\n",
        b"\x89PNG\r\n\x1a\nand something else",
    ] {
        let error = read_bytes(bytes).unwrap_err();
        assert!(matches!(error, ImageError::Malformed { .. }), "{error}");
    }
    assert!(matches!(read(Path::new("/nowhere/at/all.png")), Err(ImageError::Read { .. })));
}

/// The path of a file in the fuzzing corpus.
fn of_corpus(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name)
}

#[test]
fn exr_of_other_programs_is_read_as_the_library_reads_it() {
    use exr::prelude::*;
    for name in [
        "half_none",
        "half_rle",
        "half_zips",
        "half_zip",
        "half_piz",
        "half_pxr24",
        "tiles_zip",
        "tiles_piz",
        "two_parts",
        "written_here",
    ] {
        let path = of_corpus(&format!("image_exr/{name}.exr"));
        let set =
            |(width, pixels): &mut (usize, Vec<[f32; 3]>), at: Vec2<usize>, (r, g, b, _): (f32, f32, f32, f32)| {
                pixels[at.y() * *width + at.x()] = [r, g, b];
            };
        let image = read_first_rgba_layer_from_file(
            &path,
            |size: Vec2<usize>, _| (size.width(), vec![[0.0; 3]; size.area()]),
            set,
        )
        .unwrap();
        let (width, pixels) = image.layer_data.channel_data.pixels;
        let height = pixels.len() / width;
        assert!(pixels.iter().any(|pixel| *pixel != pixels[0]), "{name}");
        let expected = Picture::new(width as u32, height as u32, Pixels::Rgb32F(pixels));
        assert!(sound(&path) == expected, "{name}");
    }
}

/// The picture in a valid file.
fn sound(path: &Path) -> Picture {
    rayo::internals::render::read(path).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn exr_shows_what_of_its_data_is_in_its_display_window() {
    use exr::prelude::*;
    // Data of 4x3 pixels at (-1, 1), in a picture of 3x3 pixels at (0, 0).
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| (at.x() as f32, at.y() as f32, 1.0_f32));
    let mut image = Image::from_channels((4, 3), channels);
    image.layer_data.attributes.layer_position = Vec2(-1, 1);
    image.attributes.display_window = IntegerBounds::new((0, 0), (3, 3));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    image.write().to_file(&path).unwrap();
    let row = |y| [[1.0, y, 1.0], [2.0, y, 1.0], [3.0, y, 1.0]];
    let expected = [[[0.0; 3]; 3], row(0.0), row(1.0)].concat();
    assert_eq!(sound(&path), Picture::new(3, 3, Pixels::Rgb32F(expected)));
}

#[test]
fn a_file_takes_only_pictures_of_its_size_and_one_of_them() {
    let folder = TempDir::new().unwrap();
    let scene = many(3, 3, 1);
    let scene = Scene { camera: scene.camera.sized(7, 4).unwrap(), ..scene };
    let tracer = Engine::Rust.prepare(None, &scene).unwrap();
    let frame = Frame::new(&*tracer, scene.camera, Settings { threads: 1 }).unwrap();
    for (name, format) in FORMATS {
        let path = folder.path().join(name);
        let into =
            |image: &mut ImageWriter| render(&frame, image, &|_| ()).map(drop).map_err(|error| error.to_string());
        for (width, height, why) in [
            (10, 4, "pixels in a row of the file: found 10, expected 7"),
            (14, 2, "pixels in a row of the file: found 14, expected 7"),
            (7, 8, "rows of the file's picture: found 8, expected 4"),
        ] {
            let mut image = ImageWriter::create(&path, format, width, height).unwrap();
            assert_eq!(into(&mut image), Err(format!("the picture cannot be traced: {why}")), "{name}");
        }
        let mut image = ImageWriter::create(&path, format, 7, 4).unwrap();
        into(&mut image).unwrap();
        let twice = "the picture cannot be traced: rows in the file already: found 4, expected 0";
        assert_eq!(into(&mut image), Err(twice.into()), "{name}");
        image.finish().unwrap();
        assert_eq!(ImageFile::open(&path).unwrap().size(), (7, 4));
    }
}

#[test]
fn compressions_that_libraries_undo_unsafely_are_refused() {
    for (name, what) in
        [("image_exr/half_b44.exr", "compression by B44"), ("image_tiff/jpeg.tiff", "compression by JPEG")]
    {
        let error = read(&of_corpus(name)).unwrap_err();
        assert!(matches!(error, ImageError::OtherKind { .. }), "{error}");
        assert!(
            error.to_string().contains(what) && error.to_string().ends_with("convert it to PNG or PFM first"),
            "{error}"
        );
    }
}

#[test]
fn what_a_file_says_takes_no_more_memory_than_the_file_can_mean() {
    for name in [
        "image_exr/an_attribute_of_gigabytes.exr",
        "image_exr/lines_of_gigabytes.exr",
        "image_exr/tiles_of_gigabytes.exr",
        "image_exr/windows_of_gigapixels.exr",
        "image_png/claims_more_than_it_has.png",
        "image_tiff/tiles_of_gigapixels.tiff",
        "image_tiff/values_of_megabytes.tiff",
    ] {
        let error = read(&of_corpus(name)).unwrap_err();
        assert!(matches!(error, ImageError::Malformed { .. }), "{name}: {error}");
    }
    // Whether this file really has so many pixels is only found out when it is compared with
    // another.
    assert_eq!(ImageFile::open(&of_corpus("image_png/bomb.png")).unwrap().size(), (8000, 1000));
}

#[test]
fn a_colour_profile_of_a_png_is_not_unpacked() {
    const UNPACKED: u64 = 64 << 20;
    let mut packed = flate2::write::ZlibEncoder::new(b"iCCPx\0\0".to_vec(), flate2::Compression::fast());
    std::io::copy(&mut std::io::repeat(0).take(UNPACKED), &mut packed).unwrap();
    let chunk = packed.finish().unwrap();
    let chunk = [&(chunk.len() as u32 - 4).to_be_bytes()[..], &chunk, &crc(&chunk)].concat();
    // Insert the chunk after the signature and IHDR.
    let mut png = bytes_of_tiny(Format::Png);
    png.splice(33..33, chunk);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("of_a_profile.png");
    fs::write(&path, png).unwrap();
    let (picture, peak) = crate::counting::peak_of(|| read(&path));
    assert!(picture.is_ok() && peak < 8 << 20, "{peak} bytes");
}

#[test]
fn a_row_of_a_png_may_be_many_times_as_long_as_its_file() {
    const PIXELS: u32 = 10_000_000;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, PIXELS, 1);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::One);
    encoder.set_palette(&[1, 2, 3]);
    encoder.set_compression(png::Compression::High);
    encoder.write_header().unwrap().write_image_data(&vec![0; PIXELS as usize / 8]).unwrap();
    let picture = read_bytes(&bytes).unwrap();
    assert!(picture.pixels == Pixels::Rgb8(vec![[1, 2, 3]; PIXELS as usize]), "other pixels");
}

#[test]
fn a_file_cut_off_anywhere_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    for (name, format) in FORMATS {
        let path = directory.path().join(name);
        write(&path, format, (4, 3), 3).unwrap();
        let bytes = fs::read(&path).unwrap();
        // Some formats end with bytes that may be missing: the newline of a P3 file, the end marker
        // of a QOI, a TIFF's offset of the next directory, and the chunks of a PNG after that of
        // the last pixel.
        let (_, needed) = [(Format::Png, 21 + 12), (Format::PpmText, 2), (Format::Qoi, 8), (Format::Tiff, 4)]
            .into_iter()
            .find(|(with_end, _)| *with_end == format)
            .unwrap_or((format, 0));
        for length in 0..bytes.len() - needed {
            fs::write(&path, &bytes[..length]).unwrap();
            assert!(read(&path).is_err(), "{name} cut to {length} of {} bytes", bytes.len());
        }
    }
}

proptest! {
    // Each case writes two files with several threads.
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn whatever_its_size_a_file_reads_back_equal_and_bands_of_any_height_give_the_same_bytes(
        width in prop_oneof![1_u32..50, Just(300)], height in 1_u32..50, band in 1_u32..60, which in 0_usize..FORMATS.len()
    ) {
        let directory = tempfile::tempdir().unwrap();
        let (name, format) = FORMATS[which];
        let path = directory.path().join(name);
        let [whole, cut] = [height, band].map(|rows| {
            write(&path, format, (width, height), rows).unwrap();
            fs::read(&path).unwrap()
        });
        prop_assert!(whole == cut);
        prop_assert!(read(&path).unwrap() == expected(format, width, height));
        prop_assert_eq!(names(&directory), [name]);
    }
}
