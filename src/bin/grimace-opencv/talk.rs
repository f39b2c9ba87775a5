//! Communication with the program that started this one.

use std::{
    fs::File,
    io::{self, BufReader, BufWriter, Read, Stdin, Write},
};

use grimace::internal::companion::wire::{self, Message, Pixels, Request};
use serde::Serialize;

/// Largest accepted picture, pixels; `grimace` has its own limit.
const MOST_PIXELS: u64 = 1 << 32;

/// Both directions.
pub struct Talk {
    input: BufReader<Stdin>,
    output: BufWriter<Box<dyn Write>>,
}

/// Messages from the other program.
pub enum Heard {
    Asked(Request),
    Picture(Pixels),
    /// It has ended, or needs nothing more.
    Nothing,
}

impl Talk {
    /// Takes over standard input and output.
    pub fn begin() -> io::Result<Self> {
        Ok(Self { input: BufReader::new(io::stdin()), output: BufWriter::with_capacity(1 << 16, output()?) })
    }

    pub fn say(&mut self, said: &impl Serialize) -> io::Result<()> {
        wire::write_text(&mut self.output, said)?;
        self.output.flush()
    }

    pub fn show(&mut self, size: (u32, u32), channels: u8, data: &[u8]) -> io::Result<()> {
        wire::write_pixels(&mut self.output, size, channels, data)?;
        self.output.flush()
    }

    pub fn hear(&mut self) -> io::Result<Heard> {
        Ok(match wire::read(&mut self.input, MOST_PIXELS)? {
            None => Heard::Nothing,
            Some(Message::Pixels(pixels)) => Heard::Picture(pixels),
            Some(Message::Text(text)) => Heard::Asked(serde_json::from_str(&text)?),
        })
    }
}

/// Ends this program as soon as its input ends, for tasks that receive nothing: the program that started it is gone.
pub fn end_with_input() {
    std::thread::spawn(|| {
        let mut piece = [0; 64];
        while io::stdin().read(&mut piece).is_ok_and(|count| count > 0) {}
        std::process::exit(1);
    });
}

/// Reserves standard output for messages: output of libraries goes to standard error.
#[cfg(unix)]
fn output() -> io::Result<Box<dyn Write>> {
    let own = rustix::io::dup(io::stdout())?;
    rustix::stdio::dup2_stdout(io::stderr())?;
    Ok(Box::new(File::from(own)))
}

#[cfg(not(unix))]
fn output() -> io::Result<Box<dyn Write>> {
    Ok(Box::new(io::stdout()))
}
