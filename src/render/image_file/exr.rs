//! OpenEXR block by block: a header's claims are checked against the length of the file before memory is allocated.

use super::deflate::DEFLATE_EXPANSION;
use exr::math::RoundingMode;
use exr::meta::BlockDescription;
use exr::meta::attribute::{LevelMode, TileDescription};
use exr::meta::header::Header;
use exr::prelude::{ChannelDescription, Compression, IntegerBounds, LineOrder, SampleType, Text, Vec2, f16};
use image::error::{DecodingError, ImageFormatHint, UnsupportedError, UnsupportedErrorKind};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use std::io::{BufRead, Read, Seek, SeekFrom};

/// More channels than any camera has.
const MAX_CHANNELS: usize = 1024;

/// The used attributes of a part: the place of its pixels, and their packing.
struct Part {
    channels: Vec<Channel>,
    packing: Packing,
    data: Window,
    display: Window,
    /// Width and height of a tile, if it has tiles.
    tile: Option<(u32, u32)>,
    /// The number of blocks of all its levels, which a file of several parts must give.
    blocks: Option<u32>,
    /// Whether each of its pixels is a list.
    deep: bool,
}

struct Channel {
    name: Vec<u8>,
    samples: SampleType,
}

/// A compression that can be undone safely: its name in the library, and the most bytes that one byte can stand for.
#[derive(Clone, Copy)]
struct Packing {
    compression: Compression,
    expansion: u64,
}

/// A rectangle of pixels.
#[derive(Clone, Copy)]
struct Window {
    left: i64,
    top: i64,
    width: u32,
    height: u32,
}

/// Decodes the largest level of the first part that has R, G and B, and A if present, as its display window shows it.
pub(super) struct ExrDecoder<R> {
    reader: R,
    length: u64,
    part: Part,
    /// Its index among the parts, in a file of several.
    number: Option<u32>,
    /// The start of its table of blocks.
    table: u64,
}

impl<R: BufRead + Seek> ExrDecoder<R> {
    /// Reads the headers of a file of `length` bytes, within which every block must lie.
    pub(super) fn new(mut reader: R, length: u64) -> ImageResult<Self> {
        let [_, _, _, _, version, flags, zeros @ ..] = bytes::<8>(&mut reader)?;
        // Bits other than those of tiles, long names, deep data and several parts are unknown.
        let [tiled, several] = [0x02, 0x10].map(|flag| flags & flag != 0);
        if version != 2 || flags & !0x1e != 0 || zeros != [0, 0] {
            return Err(unsupported("a later version"));
        }
        let (mut chosen, mut before) = (None, 0);
        for number in 0.. {
            let Some(part) = Part::read(&mut reader, length, tiled)? else { break };
            if chosen.is_none() && !part.deep && part.shown().is_some() {
                chosen = Some((number, part));
            } else if chosen.is_none() {
                before += u64::from(part.blocks.unwrap_or_default());
            }
            if !several {
                break;
            }
        }
        let (number, part) = chosen.ok_or_else(|| damaged("it has no channels R, G and B of single values"))?;
        let table = reader.stream_position()? + 8 * before;
        Ok(ExrDecoder { reader, length, part, number: several.then_some(number), table })
    }

    /// The most pixels that a file of this length and compression can hold.
    pub(super) fn most(&self) -> u64 {
        self.length.saturating_mul(self.part.packing.expansion) / self.part.bytes_per_pixel()
    }

    /// The block at an index of the table: the numbers before its size, and its bytes.
    fn block<const N: usize>(&mut self, index: u64) -> ImageResult<([i64; N], Vec<u8>)> {
        self.reader.seek(SeekFrom::Start(self.table + 8 * index))?;
        let start = u64::from_le_bytes(bytes(&mut self.reader)?);
        self.reader.seek(SeekFrom::Start(start.min(self.length)))?;
        if let Some(number) = self.number
            && u32::from_le_bytes(bytes(&mut self.reader)?) != number
        {
            return Err(damaged("a block is of another part than its table"));
        }
        let mut place = [0; N];
        for number in &mut place {
            *number = i32::from_le_bytes(bytes(&mut self.reader)?).into();
        }
        let size = u32::from_le_bytes(bytes(&mut self.reader)?);
        taken(&mut self.reader, self.length, size.into()).map(|bytes| (place, bytes))
    }
}

impl<R: BufRead + Seek> ImageDecoder for ExrDecoder<R> {
    fn dimensions(&self) -> (u32, u32) {
        (self.part.display.width, self.part.display.height)
    }

    fn color_type(&self) -> ColorType {
        if self.part.shown().is_some_and(|[.., alpha]| alpha.is_some()) {
            ColorType::Rgba32F
        } else {
            ColorType::Rgb32F
        }
    }

    fn read_image(mut self, out: &mut [u8]) -> ImageResult<()> {
        let size = self.part.block_size();
        let header = self.part.header(size);
        let Window { width, height, .. } = self.part.data;
        let across = u64::from(width.div_ceil(size.0));
        for index in 0..across * u64::from(height.div_ceil(size.1)) {
            // Both are below 2^32, since the sides are.
            let (column, row) = ((index % across) as u32, (index / across) as u32);
            let (x, y) = (column * size.0, row * size.1);
            let (expected, packed) = if self.part.tile.is_some() {
                let (place, packed) = self.block(index)?;
                (place == [column.into(), row.into(), 0, 0], packed)
            } else {
                let (place, packed) = self.block(index)?;
                (place == [self.part.data.top + i64::from(y)], packed)
            };
            if !expected {
                return Err(damaged("a block is not the one that its table says"));
            }
            let (width, height) = (size.0.min(width - x), size.1.min(height - y));
            let unpacked = u64::from(width) * u64::from(height) * self.part.bytes_per_pixel();
            if unpacked > self.part.packing.expansion.saturating_mul(packed.len() as u64) {
                return Err(damaged("a block is too short for its pixels"));
            }
            let section = IntegerBounds::from_dimensions(Vec2(width as usize, height as usize));
            let pixels =
                self.part.packing.compression.decompress_image_section_from_le(&header, packed, section, false);
            let pixels = pixels.map_err(|error| damaged(&error.to_string()))?;
            self.part.show(&pixels, (x, y), width as usize, out);
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

impl Part {
    /// Reads the attributes of a part, of a file that may be `tiled`; None at the end of the parts.
    fn read(reader: &mut (impl BufRead + Seek), length: u64, tiled: bool) -> ImageResult<Option<Part>> {
        let (mut channels, mut packing, mut data, mut display) = (None, None, None, None);
        let (mut tile, mut blocks, mut kind) = (None, None, Vec::new());
        let mut name = text(reader)?;
        if name.is_empty() {
            return Ok(None);
        }
        while !name.is_empty() {
            text(reader)?;
            let size = u32::from_le_bytes(bytes(reader)?);
            let value = match &name[..] {
                b"channels" | b"compression" | b"dataWindow" | b"displayWindow" | b"tiles" | b"chunkCount"
                | b"type" => taken(reader, length, size.into())?,
                _ => {
                    reader.seek_relative(size.into())?;
                    Vec::new()
                }
            };
            match &name[..] {
                b"channels" => channels = Some(Channel::list(&value)?),
                b"compression" => packing = Some(Packing::of(&value)?),
                b"dataWindow" => data = Some(Window::of(&value)?),
                b"displayWindow" => display = Some(Window::of(&value)?),
                b"tiles" => tile = Some((word(&value, 0)?, word(&value, 4)?)),
                b"chunkCount" => blocks = Some(word(&value, 0)?),
                b"type" => kind = value,
                _ => {}
            }
            name = text(reader)?;
        }
        let missing = |what: &str| damaged(&format!("its header has no {what}"));
        let tiled = if kind.is_empty() { tiled } else { kind.starts_with(b"tiled") };
        let tile = if tiled { Some(tile.ok_or_else(|| missing("tiles"))?) } else { None };
        if tile.is_some_and(|(width, height)| width == 0 || height == 0) {
            return Err(damaged("its tiles have no pixels"));
        }
        Ok(Some(Part {
            channels: channels.ok_or_else(|| missing("channels"))?,
            packing: packing.ok_or_else(|| missing("compression"))?,
            data: data.ok_or_else(|| missing("dataWindow"))?,
            display: display.ok_or_else(|| missing("displayWindow"))?,
            tile,
            blocks,
            deep: kind.starts_with(b"deep"),
        }))
    }

    /// The places of red, green, blue and, if present, alpha in a pixel's bytes, and their types.
    fn shown(&self) -> Option<[Option<(usize, SampleType)>; 4]> {
        let places = [&b"R"[..], b"G", b"B", b"A"].map(|wanted| {
            let index = self.channels.iter().position(|channel| channel.name == wanted)?;
            let before = self.channels[..index].iter().map(|channel| channel.samples.bytes_per_sample()).sum();
            Some((before, self.channels[index].samples))
        });
        places[..3].iter().all(Option::is_some).then_some(places)
    }

    /// Above 0, since there are channels.
    fn bytes_per_pixel(&self) -> u64 {
        self.channels.iter().map(|channel| channel.samples.bytes_per_sample() as u64).sum()
    }

    /// Width and height of a block, except at the right and lower edges.
    fn block_size(&self) -> (u32, u32) {
        let lines = self.packing.compression.scan_lines_per_block() as u32;
        self.tile.unwrap_or((self.data.width, lines))
    }

    /// What the library needs to unpack a block of a part.
    fn header(&self, (width, height): (u32, u32)) -> Header {
        let channel = |channel: &Channel| {
            let name = Text::from_slice_unchecked(&channel.name);
            ChannelDescription::new(name, channel.samples, false)
        };
        let tile_size = Vec2(width as usize, height as usize);
        let tiles = TileDescription { tile_size, level_mode: LevelMode::Singular, rounding_mode: RoundingMode::Down };
        // The size of one block, so that it counts nothing else: the library never decodes whole pictures here.
        Header::new(Text::default(), tile_size, self.channels.iter().map(channel).collect()).with_encoding(
            self.packing.compression,
            BlockDescription::Tiles(tiles),
            LineOrder::Unspecified,
        )
    }

    /// Copies a block of pixels from its place in the data window to the display window.
    fn show(&self, pixels: &[u8], (x, y): (u32, u32), width: usize, out: &mut [u8]) {
        let Some(channels) = self.shown() else { return };
        let shown = channels.iter().flatten().count();
        let (data, display) = (&self.data, &self.display);
        let left = data.left + i64::from(x) - display.left;
        for (row, line) in (0..).zip(pixels.chunks_exact(width * self.bytes_per_pixel() as usize)) {
            let below = data.top + i64::from(y) + row - display.top;
            if !(0..i64::from(display.height)).contains(&below) {
                continue;
            }
            for (to, (before, samples)) in channels.into_iter().flatten().enumerate() {
                let size = samples.bytes_per_sample();
                let line = &line[width * before..][..width * size];
                for (across, sample) in (left..).zip(line.chunks_exact(size)) {
                    if (0..i64::from(display.width)).contains(&across) {
                        let pixel = below as usize * display.width as usize + across as usize;
                        out[4 * (pixel * shown + to)..][..4].copy_from_slice(&value(samples, sample).to_ne_bytes());
                    }
                }
            }
        }
    }
}

/// A sample in the byte order of this machine.
fn value(samples: SampleType, bytes: &[u8]) -> f32 {
    match (samples, bytes) {
        (SampleType::F16, &[a, b]) => f16::from_ne_bytes([a, b]).to_f32(),
        (SampleType::U32, &[a, b, c, d]) => u32::from_ne_bytes([a, b, c, d]) as f32,
        (_, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
        _ => unreachable!("samples have two bytes or four"),
    }
}

impl Channel {
    fn list(mut value: &[u8]) -> ImageResult<Vec<Channel>> {
        let mut channels = Vec::new();
        loop {
            let name = text(&mut value)?;
            if name.is_empty() && !channels.is_empty() {
                return Ok(channels);
            }
            let fields = bytes::<16>(&mut value)?;
            let samples = match word(&fields, 0)? {
                0 => SampleType::U32,
                1 => SampleType::F16,
                2 => SampleType::F32,
                _ => return Err(damaged("a channel is of no known type")),
            };
            if (word(&fields, 8)?, word(&fields, 12)?) != (1, 1) {
                return Err(unsupported("channels of fewer samples than pixels"));
            }
            channels.push(Channel { name, samples });
            if channels.len() > MAX_CHANNELS {
                return Err(damaged("it has too many channels"));
            }
        }
    }
}

impl Packing {
    fn of(value: &[u8]) -> ImageResult<Packing> {
        let (compression, expansion) = match value {
            [0] => (Compression::Uncompressed, 1),
            // Two bytes repeat one up to 128 times.
            [1] => (Compression::RLE, 64),
            [2] => (Compression::ZIP1, DEFLATE_EXPANSION),
            [3] => (Compression::ZIP16, DEFLATE_EXPANSION),
            // Nine bits repeat two bytes up to 255 times; the wavelets leave that many zeros of a smooth picture.
            [4] => (Compression::PIZ, 512),
            // Deflate gets three of four bytes.
            [5] => (Compression::PXR24, DEFLATE_EXPANSION * 4 / 3),
            [6 | 7] => return Err(unsupported("compression by B44")),
            [8 | 9] => return Err(unsupported("compression by DWA")),
            _ => return Err(unsupported("an unknown compression")),
        };
        Ok(Packing { compression, expansion })
    }
}

impl Window {
    fn of(value: &[u8]) -> ImageResult<Window> {
        let side = |at| word(value, at).map(|word| i64::from(word.cast_signed()));
        let (left, top, right, bottom) = (side(0)?, side(4)?, side(8)?, side(12)?);
        let length = |first: i64, last: i64| u32::try_from(last - first + 1).ok().filter(|length| *length > 0);
        let (width, height) =
            length(left, right).zip(length(top, bottom)).ok_or_else(|| damaged("a window is empty"))?;
        Ok(Window { left, top, width, height })
    }
}

/// The next number.
fn bytes<const N: usize>(reader: &mut impl Read) -> ImageResult<[u8; N]> {
    let mut bytes = [0; N];
    reader.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// A text up to its terminating zero.
fn text(reader: &mut impl BufRead) -> ImageResult<Vec<u8>> {
    const LONGEST: u64 = 256;
    let mut text = Vec::new();
    reader.by_ref().take(LONGEST).read_until(0, &mut text)?;
    if text.pop() == Some(0) { Ok(text) } else { Err(damaged("a name in its header has no end")) }
}

/// The next `size` bytes, if a file of `length` can hold them.
fn taken(reader: &mut impl Read, length: u64, size: u64) -> ImageResult<Vec<u8>> {
    if size > length {
        return Err(damaged("a part of it is longer than the file"));
    }
    let mut bytes = vec![0; size as usize];
    reader.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn word(value: &[u8], at: usize) -> ImageResult<u32> {
    let word = value.get(at..).and_then(|rest| rest.first_chunk());
    word.map(|word| u32::from_le_bytes(*word)).ok_or_else(|| damaged("an attribute is too short"))
}

fn damaged(what: &str) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::OpenExr), what))
}

fn unsupported(what: &str) -> ImageError {
    let kind = UnsupportedErrorKind::GenericFeature(what.into());
    ImageError::Unsupported(UnsupportedError::from_format_and_kind(ImageFormatHint::Exact(ImageFormat::OpenExr), kind))
}
