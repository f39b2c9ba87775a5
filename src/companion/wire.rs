//! The protocol between this program and `grimace-opencv`.
//!
//! A message has a kind (1 byte), the length of its content (4 bytes, little endian), and the content. Kind 0 is JSON, one of the two
//! enumerations here. Kind 1 is pixels: width and height (4 bytes each), the channels of a pixel (1 byte), then the rows from the top.

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};

/// Version of the protocol, which must be equal on both sides.
pub const VERSION: u32 = 3;

const TEXT: u8 = 0;
const PIXELS: u8 = 1;

/// Longest text, bytes.
const MOST_TEXT: u32 = 1 << 20;

/// Bytes before the rows of a picture.
const PICTURE_HEAD: usize = 9;

/// Most channels of a pixel.
const MOST_CHANNELS: u64 = 3;

/// Requests of this program, other than pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Request {
    /// Finds points of one frame in another, by pyramidal KLT.
    Find {
        /// Frames by slot: 0 neutral, 1 previous, 2 current.
        from: u8,
        /// The frame to search.
        to: u8,
        /// Side of the window, px.
        window: u32,
        /// Pyramid levels.
        levels: u32,
        /// Positions of the points, px.
        points: Vec<[f32; 2]>,
        /// Start positions of the search, px.
        guesses: Vec<[f32; 2]>,
    },
    /// No more frames.
    End,
}

/// Replies of `grimace-opencv`, other than pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// The first message.
    Hello {
        /// [`VERSION`].
        version: u32,
    },
    /// Header data of an open video; frames follow.
    Video {
        /// Frames per second; 0 if the file does not state it.
        fps: f64,
        /// Number of frames; 0 or less if the file does not state it, an estimate in some containers.
        frames: f64,
        /// Columns; 0 if the file does not state it.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A frame that is not sent, or not yet.
    Passed {
        /// Time of the frame, seconds from the start of the video; `None` if unknown.
        seconds: Option<f64>,
    },
    /// Time of the frame that follows; omitted if unknown.
    Time {
        /// Seconds from the start of the video.
        seconds: f64,
    },
    /// The end of a video.
    End {
        /// Frames that it has.
        frames: u32,
    },
    /// Found points: position and mean grey difference of the windows, or `None` for a lost point.
    Found(Vec<Option<[f32; 3]>>),
    /// The largest face and candidates for its eyes.
    Face(Option<FaceBoxes>),
    /// Ready for the next picture.
    Ready,
    /// All is written.
    Done,
    /// There is no encoder for a film of this kind.
    NoEncoder {
        /// Codecs that were tried.
        tried: String,
    },
    /// The request failed.
    Failed {
        /// Why.
        reason: String,
    },
}

/// Boxes found by Haar cascades: left, top, width, height, px.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaceBoxes {
    /// The largest face.
    pub face: [i32; 4],
    /// Boxes found by each eye cascade in the upper part of the face.
    pub eyes: [Vec<[i32; 4]>; 2],
}

/// A picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// 1 for grey, 3 for red, green and blue.
    pub channels: u8,
    /// Rows from the top.
    pub data: Vec<u8>,
}

/// What was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// JSON.
    Text(String),
    /// A picture.
    Pixels(Pixels),
}

/// Writes a text message.
///
/// # Errors
/// When the connection is closed.
pub fn write_text(out: &mut impl Write, said: &impl Serialize) -> io::Result<()> {
    let text = serde_json::to_vec(said)?;
    let length = u32::try_from(text.len()).ok().filter(|length| *length <= MOST_TEXT).ok_or_else(|| wrong("it is too long"))?;
    out.write_all(&[TEXT])?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(&text)
}

/// Writes a picture.
///
/// # Errors
/// When the connection is closed, or the number of bytes does not match the size.
pub fn write_pixels(out: &mut impl Write, (width, height): (u32, u32), channels: u8, data: &[u8]) -> io::Result<()> {
    let length = u32::try_from(PICTURE_HEAD + data.len()).map_err(|_| wrong("the picture is too large"))?;
    if data.len() as u64 != u64::from(width) * u64::from(height) * u64::from(channels) {
        return Err(wrong("the picture is not as large as it says"));
    }
    out.write_all(&[PIXELS])?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(&width.to_le_bytes())?;
    out.write_all(&height.to_le_bytes())?;
    out.write_all(&[channels])?;
    out.write_all(data)
}

/// Reads a message, with a picture of at most `most` pixels; `None` if the other side has ended.
///
/// # Errors
/// When the connection breaks within a message, and [`io::ErrorKind::InvalidData`] for an invalid message.
pub fn read(input: &mut impl Read, most: u64) -> io::Result<Option<Message>> {
    let mut head = [0; 5];
    if input.read(&mut head[..1])? == 0 {
        return Ok(None);
    }
    input.read_exact(&mut head[1..])?;
    let [kind, length @ ..] = head;
    let length = u32::from_le_bytes(length);
    match kind {
        TEXT if length <= MOST_TEXT => {
            let mut text = vec![0; length as usize];
            input.read_exact(&mut text)?;
            String::from_utf8(text).map(|text| Some(Message::Text(text))).map_err(|_| wrong("text that is not UTF-8"))
        }
        PIXELS if length as usize >= PICTURE_HEAD => {
            let mut head = [0; PICTURE_HEAD];
            input.read_exact(&mut head)?;
            let [a, b, c, d, e, f, g, h, channels] = head;
            let (width, height) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
            let size = u64::from(width) * u64::from(height);
            if size > most || u64::from(channels) > MOST_CHANNELS {
                return Err(wrong(&format!("a picture of {width}x{height}")));
            }
            if size * u64::from(channels) != u64::from(length) - PICTURE_HEAD as u64 {
                return Err(wrong("a picture that is not as large as it says"));
            }
            let mut data = vec![0; length as usize - PICTURE_HEAD];
            input.read_exact(&mut data)?;
            Ok(Some(Message::Pixels(Pixels { width, height, channels, data })))
        }
        _ => Err(wrong(&format!("a message of kind {kind} and {length} bytes"))),
    }
}

fn wrong(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(bytes: &[u8]) -> io::ErrorKind {
        read(&mut &*bytes, 100).unwrap_err().kind()
    }

    #[test]
    fn written_values_are_read() {
        let find = Request::Find { from: 1, to: 2, window: 9, levels: 4, points: vec![[0.1, 1e-7]], guesses: vec![[3.5, -2.0]] };
        let mut bytes = Vec::new();
        write_text(&mut bytes, &find).unwrap();
        write_pixels(&mut bytes, (3, 2), 1, b"abcdef").unwrap();
        let mut input = bytes.as_slice();
        let Some(Message::Text(text)) = read(&mut input, 100).unwrap() else { panic!("no text") };
        assert_eq!(serde_json::from_str::<Request>(&text).unwrap(), find);
        let pixels = Pixels { width: 3, height: 2, channels: 1, data: b"abcdef".to_vec() };
        assert_eq!(read(&mut input, 100).unwrap(), Some(Message::Pixels(pixels)));
        assert_eq!(read(&mut input, 100).unwrap(), None);
    }

    #[test]
    fn nothing_is_held_for_what_cannot_be() {
        assert_eq!(refused(b"\x07\x00\x00\x00\x00"), io::ErrorKind::InvalidData);
        // A text of 4 GB, a picture shorter than its header.
        assert_eq!(refused(b"\x00\xff\xff\xff\xff"), io::ErrorKind::InvalidData);
        assert_eq!(refused(b"\x01\x03\x00\x00\x00abc"), io::ErrorKind::InvalidData);
        let picture = |width: u32, height: u32, channels: u8, length: u32| {
            [&[1], &length.to_le_bytes()[..], &width.to_le_bytes(), &height.to_le_bytes(), &[channels]].concat()
        };
        // 11 x 10 is more than 100 pixels; 65536 x 65536 x 3 + 9 wraps around in 32 bits; 4 channels; a length that does not fit.
        assert_eq!(refused(&picture(11, 10, 1, 119)), io::ErrorKind::InvalidData);
        assert_eq!(refused(&picture(65_536, 65_536, 3, 9)), io::ErrorKind::InvalidData);
        assert_eq!(refused(&picture(2, 2, 4, 25)), io::ErrorKind::InvalidData);
        assert_eq!(refused(&picture(2, 2, 1, 14)), io::ErrorKind::InvalidData);
        // Cut off.
        assert_eq!(refused(&picture(2, 2, 1, 13)), io::ErrorKind::UnexpectedEof);
        assert_eq!(refused(b"\x00\x05\x00\x00\x00ab"), io::ErrorKind::UnexpectedEof);
        assert_eq!(refused(b"\x01\x05"), io::ErrorKind::UnexpectedEof);
    }
}
