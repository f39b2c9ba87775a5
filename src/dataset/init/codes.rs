//! File names of published sets of photographs: KDEF, `RaFD`, CFD and `NimStim`.

use super::{SEPARATORS, emotions::emotion_of};

/// The information in a file name.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Coded {
    /// Equal for pictures that form pairs.
    pub person: String,
    /// The person.
    pub subject: String,
    /// Emotion.
    pub emotion: &'static str,
    /// Expression as in the name.
    pub kind: String,
    /// Name of the sequence.
    pub word: String,
    /// Whether the face is seen from the side.
    pub is_side: bool,
}

/// Expressions of KDEF and of CFD.
const KDEF: [(&str, &str); 7] = [
    ("AF", "fear"),
    ("AN", "anger"),
    ("DI", "disgust"),
    ("HA", "happiness"),
    ("NE", "neutral"),
    ("SA", "sadness"),
    ("SU", "surprise"),
];
const CFD: [(&str, &str); 5] = [("N", "neutral"), ("A", "anger"), ("F", "fear"), ("HC", "happiness"), ("HO", "happiness")];

/// Expressions of `NimStim`.
const NIMSTIM: [(&str, &str); 8] = [
    ("AN", "anger"),
    ("CA", "calm"),
    ("DI", "disgust"),
    ("FE", "fear"),
    ("HA", "happiness"),
    ("NE", "neutral"),
    ("SA", "sadness"),
    ("SP", "surprise"),
];

/// The information in the name of a picture of one of these sets, without extension.
pub(super) fn coded(stem: &str) -> Option<Coded> {
    kdef(stem).or_else(|| rafd(stem)).or_else(|| cfd(stem)).or_else(|| nimstim(stem))
}

fn emotion_in(codes: &[(&str, &'static str)], code: &str) -> Option<&'static str> {
    codes.iter().find(|(known, _)| *known == code).map(|(_, emotion)| *emotion)
}

/// `AF01HAS`: session, sex and number of the person, expression, view. A person has two sessions.
fn kdef(stem: &str) -> Option<Coded> {
    let stem = stem.to_ascii_uppercase();
    if !stem.is_ascii() || !(7..=8).contains(&stem.len()) {
        return None;
    }
    let (person, code, view) = (&stem[..4], &stem[4..6], &stem[6..]);
    let (session, subject) = person.split_at(1);
    let is_person =
        ["A", "B"].contains(&session) && ["F", "M"].contains(&&subject[..1]) && subject[1..].bytes().all(|b| b.is_ascii_digit());
    if !is_person || !["S", "HL", "HR", "FL", "FR"].contains(&view) {
        return None;
    }
    let emotion = emotion_in(&KDEF, code)?;
    let word = format!("{session}-{code}");
    Some(Coded {
        person: person.to_owned(),
        subject: subject.to_owned(),
        emotion,
        kind: code.to_owned(),
        word,
        is_side: view != "S",
    })
}

/// `Rafd090_01_Caucasian_female_angry_frontal`: angle of the camera, person, expression, gaze.
fn rafd(stem: &str) -> Option<Coded> {
    let [set, number, _, _, expression, gaze] = stem.split('_').collect::<Vec<_>>()[..] else { return None };
    let angle = set.to_ascii_lowercase().strip_prefix("rafd")?.parse::<u32>().ok()?;
    number.parse::<u32>().ok()?;
    let emotion = emotion_of(expression)?;
    let subject = format!("Rafd{number}");
    let person = format!("{subject}_{angle:03}_{gaze}");
    let word = format!("{expression}-{gaze}");
    Some(Coded { person, subject, emotion, kind: expression.to_owned(), word, is_side: angle != 90 })
}

/// `01F_HA_O`: number and sex of the person, expression, mouth (closed, open, or exuberant). The neutral face with an open mouth is an
/// expression beside that with a closed one.
fn nimstim(stem: &str) -> Option<Coded> {
    let [person, code, mouth] = stem.split('_').collect::<Vec<_>>()[..] else { return None };
    let number = person.strip_suffix(['F', 'M', 'f', 'm'])?;
    let is_number = !number.is_empty() && number.len() < 4 && number.bytes().all(|b| b.is_ascii_digit());
    let mouth = mouth.to_ascii_uppercase();
    if !is_number || !["C", "O", "X"].contains(&mouth.as_str()) {
        return None;
    }
    let (code, subject) = (code.to_ascii_uppercase(), person.to_ascii_uppercase());
    let emotion = match emotion_in(&NIMSTIM, &code)? {
        "neutral" if mouth != "C" => "mouth_open",
        emotion => emotion,
    };
    let word = format!("{code}-{mouth}");
    Some(Coded { person: subject.clone(), subject, emotion, kind: word.clone(), word, is_side: false })
}

/// `CFD-WF-001-003-N`: group and number of the person, picture, expression.
fn cfd(stem: &str) -> Option<Coded> {
    let [set, group, number, _, code] = stem.split(SEPARATORS).collect::<Vec<_>>()[..] else { return None };
    if !set.eq_ignore_ascii_case("CFD") {
        return None;
    }
    let (code, subject) = (code.to_ascii_uppercase(), format!("{group}-{number}"));
    let emotion = emotion_in(&CFD, &code)?;
    Some(Coded { person: subject.clone(), subject, emotion, kind: code.clone(), word: code, is_side: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_published_sets_are_read() {
        let read = |stem: &str| {
            let Coded { person, subject, emotion, word, is_side, .. } = coded(stem)?;
            Some((person, subject, emotion, word, is_side))
        };
        let expected = |person: &str, subject: &str, emotion, word: &str, is_side| {
            Some((person.to_owned(), subject.to_owned(), emotion, word.to_owned(), is_side))
        };
        assert_eq!(read("AF01HAS"), expected("AF01", "F01", "happiness", "A-HA", false));
        assert_eq!(read("bm35nehl"), expected("BM35", "M35", "neutral", "B-NE", true));
        assert_eq!(read("CFD-WF-001-003-N"), expected("WF-001", "WF-001", "neutral", "N", false));
        assert_eq!(read("CFD-BM-012-020-HO"), expected("BM-012", "BM-012", "happiness", "HO", false));
        let rafd = "Rafd090_01_Caucasian_female_angry_frontal";
        assert_eq!(read(rafd), expected("Rafd01_090_frontal", "Rafd01", "anger", "angry-frontal", false));
        assert!(coded("Rafd045_01_Caucasian_female_angry_left").is_some_and(|coded| coded.is_side));
        assert_eq!(read("01F_HA_O"), expected("01F", "01F", "happiness", "HA-O", false));
        assert_eq!(read("1f_ne_o"), expected("1F", "1F", "mouth_open", "NE-O", false));
        for other in [
            "01F_HA_Z",
            "1234F_HA_C",
            "F_HA_C",
            "01X_HA_C",
            "AF01",
            "AF01XXS",
            "L001",
            "CF01HAS",
            "\u{e9}F01HAS",
            "a_b_c_d_e_f",
            "CFD-1-2-3-4",
        ] {
            assert_eq!(read(other), None, "{other}");
        }
    }
}
