//! Determines which number in a file name is the frame number.

use std::{cmp::Ordering, path::Path};

/// Numbering of the files in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Numbering {
    /// The digits of each file's number, as in its name.
    Named(Vec<String>),
    /// Several numbers vary: the position of each file in the order of names, from 1.
    Counted(Vec<u32>),
}

/// A name split into text, digits, text, digits and so on.
struct Name {
    /// The texts before each run of digits, and after the last.
    texts: Vec<String>,
    /// Runs of digits.
    digits: Vec<String>,
}

impl Name {
    fn new(path: &Path) -> Self {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let (mut texts, mut digits, mut rest) = (Vec::new(), Vec::new(), &*stem);
        while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
            let (text, behind) = rest.split_at(start);
            let end = behind.find(|c: char| !c.is_ascii_digit()).unwrap_or(behind.len());
            let (number, behind) = behind.split_at(end);
            texts.push(text.to_owned());
            digits.push(number.to_owned());
            rest = behind;
        }
        texts.push(rest.to_owned());
        Self { texts, digits }
    }

    /// Key that compares a number of any length by its value.
    fn value(&self, k: usize) -> (usize, &str) {
        self.digits.get(k).map_or((0, ""), |digits| value_of(digits))
    }

    fn last(&self) -> (usize, &str) {
        self.value(self.digits.len().saturating_sub(1))
    }

    /// Whether a number has a minus sign without a letter or digit before it: `f_-1`, but not `2024-05` nor `frame-1`.
    fn is_negative(&self, k: usize) -> bool {
        let before = self.texts.get(k).and_then(|text| text.strip_suffix('-'));
        before.is_some_and(|before| before.chars().next_back().map_or(k == 0, |c| !c.is_alphanumeric()))
    }

    /// Natural order: text as text, numbers by value, negative ones first.
    fn compare(&self, other: &Self) -> Ordering {
        let text = |name: &'_ Self, k: usize| -> String {
            let text = name.texts.get(k).map_or("", String::as_str);
            (if name.is_negative(k) { text.strip_suffix('-').unwrap_or(text) } else { text }).to_owned()
        };
        let number = |k: usize| match (self.is_negative(k), other.is_negative(k)) {
            (false, false) => self.value(k).cmp(&other.value(k)),
            (true, true) => other.value(k).cmp(&self.value(k)),
            (here, there) => there.cmp(&here),
        };
        let places = 0..self.texts.len().max(other.texts.len());
        places.map(|k| text(self, k).cmp(&text(other, k)).then_with(|| number(k))).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
    }
}

/// The texts around the numbers in a file's name, in lower case.
pub(super) fn pattern(path: &Path) -> Vec<String> {
    Name::new(path).texts.iter().map(|text| text.to_lowercase()).collect()
}

/// Key that compares digits of any length by their value.
pub(super) fn value_of(digits: &str) -> (usize, &str) {
    let plain = digits.trim_start_matches('0');
    (plain.len(), plain)
}

/// Pads the digits after points to equal length if they are decimals, and returns whether there are any. Programs that omit trailing zeros
/// print decimals of different lengths, none of which ends with a zero except `0` itself. (`1.9` and `1.10` are items 9 and 10.)
fn align_decimals(names: &mut [Name]) -> bool {
    let mut are_there = false;
    let groups = names.iter().map(|name| name.digits.len()).max().unwrap_or(0);
    for k in 1..groups {
        let with: Vec<&Name> = names.iter().filter(|name| name.digits.len() > k).collect();
        let lengths = with.iter().map(|name| name.digits[k].len());
        let (Some(least), Some(most)) = (lengths.clone().min(), lengths.max()) else { continue };
        let is_decimal = |name: &&Name| name.texts[k] == "." && (name.digits[k] == "0" || !name.digits[k].ends_with('0'));
        if least < most && with.iter().all(is_decimal) {
            let digits = names.iter_mut().filter_map(|name| name.digits.get_mut(k));
            digits.for_each(|digits| digits.push_str(&"0".repeat(most - digits.len())));
            are_there = true;
        }
    }
    are_there
}

/// Numbers the files of one folder by their names, each of which contains digits.
///
/// The number is the last one in the name if no two files share it, and if it gives the natural order of the names or is all that varies.
/// Otherwise it is the only number that varies. If several vary (dates with times, negative numbers), or if it is a decimal, files are
/// counted in the natural order of their names. If a number is too large for a frame number, as in millisecond clocks, files are counted in
/// its order.
pub(super) fn numbered<P: AsRef<Path>>(files: &[P]) -> Numbering {
    match by_names(files) {
        Numbering::Named(digits) if digits.iter().any(|digits| digits.parse::<u32>().is_err()) => counted(digits),
        numbering => numbering,
    }
}

/// Counts files in the order of their numbers, of any length. Files with equal numbers are not counted, so that the duplicate is reported.
fn counted(digits: Vec<String>) -> Numbering {
    let value = |k: usize| value_of(&digits[k]);
    let mut order: Vec<usize> = (0..digits.len()).collect();
    order.sort_by(|&a, &b| value(a).cmp(&value(b)));
    if order.windows(2).any(|pair| value(pair[0]) == value(pair[1])) {
        return Numbering::Named(digits);
    }
    places(&order)
}

/// The position of each file, from 1, given their order.
fn places(order: &[usize]) -> Numbering {
    let mut places = vec![0; order.len()];
    (1..).zip(order).for_each(|(number, &k)| places[k] = number);
    Numbering::Counted(places)
}

/// Numbers as they appear in the names.
fn by_names<P: AsRef<Path>>(files: &[P]) -> Numbering {
    let mut names: Vec<Name> = files.iter().map(|file| Name::new(file.as_ref())).collect();
    let has_decimals = align_decimals(&mut names);
    let last = || Numbering::Named(names.iter().map(|name| name.digits.last().cloned().unwrap_or_default()).collect());
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by(|&a, &b| names[a].compare(&names[b]));
    let in_order = order.windows(2).all(|pair| names[pair[0]].last() < names[pair[1]].last());
    if in_order && !has_decimals {
        return last();
    }
    let groups = names.iter().map(|name| name.digits.len()).max().unwrap_or(0);
    let varies = |k: usize| names.iter().any(|name| name.digits.len() <= k || name.value(k) != names[0].value(k));
    let varying: Vec<usize> = (0..groups).filter(|&k| varies(k)).collect();
    let is_mixed = |k: usize| {
        let below = names.iter().filter(|name| name.is_negative(k)).count();
        below > 0 && below < names.len()
    };
    // Names that compare equal are duplicates of a frame.
    let is_twice = order.windows(2).any(|pair| names[pair[0]].compare(&names[pair[1]]).is_eq());
    match varying[..] {
        _ if is_twice => last(),
        [] if !(0..groups).any(is_mixed) => last(),
        [k] if !has_decimals && names.iter().all(|name| name.digits.len() == groups) && !is_mixed(k) => {
            Numbering::Named(names.iter().filter_map(|name| name.digits.get(k).cloned()).collect())
        }
        _ => places(&order),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn numbers(names: &[&str]) -> Vec<u32> {
        match numbered(names) {
            Numbering::Named(digits) => digits.iter().map(|d| d.parse().unwrap()).collect(),
            Numbering::Counted(places) => places,
        }
    }

    #[test]
    fn the_number_is_the_last_in_the_name_where_that_says_the_order() {
        assert_eq!(numbers(&["a10.png", "a9.png", "a2.jpg", "a0011.webp"]), [10, 9, 2, 11]);
        assert_eq!(numbers(&["S005_001_00000012.png", "S005_001_00000013.png"]), [12, 13]);
        assert_eq!(numbers(&["S005_001_00000012_landmarks.txt"]), [12]);
        assert_eq!(numbers(&["12\u{e9}7\u{fc}.v2.png"]), [2]);
        assert_eq!(numbers(&["b1.png", "a2.png"]), [1, 2], "nothing else varies");
        assert_eq!(numbers(&["cam1_7.png", "cam2_8.png"]), [7, 8], "both give the same order");
        assert_eq!(numbers(&["f_-5.png", "f_-4.png"]), [5, 4], "if every number has a minus sign, it is a dash");
        assert_eq!(numbers(&["f1.png", "f01.jpg"]), [1, 1]);
        assert_eq!(numbers(&["left_1.png", "left_2.png", "right_1.png", "right_2.png"]), [1, 2, 1, 2], "two sets");
    }

    #[test]
    fn numbers_of_clocks_that_are_too_long_are_counted_in_their_order() {
        assert_eq!(numbers(&["IMG_20240501123100.png", "IMG_20240501123059.png", "IMG_20240501123102.png"]), [2, 1, 3]);
        assert_eq!(numbers(&["1716900000123.png", "99.png"]), [2, 1], "in numerical, not in alphabetical order");
        // Numbers up to 4294967295 are kept; a number that two files share is kept, and reported as a duplicate.
        assert_eq!(numbers(&["4294967295.png", "4294967294.png"]), [u32::MAX, u32::MAX - 1]);
        assert!(matches!(numbered(&["a4294967296.png", "a04294967296.png"]), Numbering::Named(_)));
    }

    #[test]
    fn a_number_that_alone_varies_is_the_frames() {
        assert_eq!(numbers(&["002_cam2.png", "001_cam2.png"]), [2, 1]);
        assert_eq!(numbers(&["10_640x480.png", "9_640x480.png"]), [10, 9]);
    }

    #[test]
    fn files_whose_names_vary_in_several_numbers_are_counted() {
        assert_eq!(
            numbers(&["2024-05-01_12-31-00.png", "2024-05-01_12-30-50.png", "2024-05-01_12-30-59.png"]),
            [3, 1, 2],
            "over a minute"
        );
        assert_eq!(numbers(&["t_1700000000.800000.png", "t_1700000001.000000.png", "t_1700000000.900000.png"]), [1, 3, 2]);
        let seconds = ["17.0", "17.05", "17.1", "17.15", "18.3"].map(|t| format!("t_{t}.png"));
        assert_eq!(numbers(&seconds.each_ref().map(String::as_str)), [1, 2, 3, 4, 5], "without zeros at the end");
        assert_eq!(numbers(&["0.04.png", "0.2.png", "0.12.png"]), [1, 3, 2], "hundredths");
        assert_eq!(numbers(&["v1.9.png", "v1.10.png", "v1.11.png"]), [9, 10, 11], "the ninth, the tenth");
        assert_eq!(numbers(&["f_-1.png", "f_1.png", "f_0.png", "f_-10.png"]), [2, 4, 3, 1], "below zero");
        assert_eq!(numbers(&["f_-1.png", "f_1.png"]), [1, 2]);
        assert_eq!(numbers(&["take2_001.png", "take10_002.png", "take1_005.png"]), [2, 3, 1]);
        assert_eq!(numbers(&["f_-1.png", "f_1.png", "f_1.jpg"]), [1, 1, 1], "the same number twice");
    }

    proptest! {
        #[test]
        fn any_names_are_numbered(names in prop::collection::vec("[a-b0-2_-]{0,4}[0-2][a-b_-]{0,2}", 0..6)) {
            let count = match numbered(&names) {
                Numbering::Named(digits) => {
                    prop_assert!(digits.iter().all(|d| !d.is_empty() && d.bytes().all(|b| b.is_ascii_digit())));
                    digits.len()
                }
                Numbering::Counted(places) => places.len(),
            };
            prop_assert_eq!(count, names.len());
        }
    }
}
