//! `decode grey|colour FIRST MOST_PIXELS FILE`: sends a video's header data, then its frames from number FIRST (counted from 1) on, each
//! with its time if known, then the number of frames. Of those before FIRST only the times are sent.

use std::{ffi::OsString, path::Path};

use grimace::internal::companion::wire::Reply;

use crate::{
    Trouble,
    film::Film,
    number,
    talk::{Talk, end_with_input},
};

pub fn run(arguments: &[OsString], talk: &mut Talk) -> Result<(), Trouble> {
    end_with_input();
    let is_coloured = arguments.first().is_some_and(|word| word == "colour");
    let (first, most) = (number::<u32>(arguments, 1)?, number::<u64>(arguments, 2)?);
    let mut film = Film::open(Path::new(arguments.get(3).map(OsString::as_os_str).unwrap_or_default()))?;
    let (header, pixels) = film.header();
    talk.say(&header)?;
    if pixels > most {
        // The other program reports that it is too large, with the limit.
        return Ok(());
    }
    let (mut count, mut before) = (0, None);
    while film.advance(count + 1)? {
        count += 1;
        let time = film.time(before);
        before = time.or(before);
        if count < first {
            talk.say(&Reply::Passed { seconds: time })?;
            continue;
        }
        if let Some(seconds) = time {
            talk.say(&Reply::Time { seconds })?;
        }
        let picture = film.picture(is_coloured)?;
        talk.show(picture.size, picture.channels, &picture.data)?;
    }
    talk.say(&Reply::End { frames: count })?;
    Ok(())
}
