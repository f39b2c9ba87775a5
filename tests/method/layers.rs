//! The order of the library's modules: each imports only earlier ones. `docs/architecture.md` describes the layers.

use std::{fs, path::Path};

use crate::common::root;

/// Modules from the lowest layer up. A module may import those of lower layers and the earlier ones of its own layer.
const LAYERS: [(&str, &[&str]); 5] = [
    (
        "ground",
        &[
            "text",
            "units",
            "geometry",
            "robust",
            "simd",
            "least_squares",
            "formula",
            "foreign",
            "input",
            "interpolation",
            "output",
            "companion",
            "wireframe",
            "model",
            "plausible",
            "positions",
            "correspondence",
        ],
    ),
    ("sources", &["dataset", "sequence"]),
    ("method", &["locate", "fit", "track", "normalize", "statistics", "fap", "pose", "features", "segment"]),
    ("making", &["overlay", "warp", "mesh", "render", "synthesis", "clone", "player", "errors"]),
    ("tool", &["columnar", "report", "pipeline", "annotate", "cli", "fuzzing"]),
];

/// Returns the index of a module in the order.
fn rank(module: &str) -> Option<usize> {
    LAYERS.iter().flat_map(|(_, modules)| *modules).position(|m| *m == module)
}

/// Returns a file without its tests and with blanked comments; line numbers do not change.
fn code(text: &str) -> String {
    let tests = text.find("#[cfg(test)]\nmod ").or_else(|| text.find("#[cfg(test)]\n#[allow")).unwrap_or(text.len());
    let line = |line: &str| if line.trim_start().starts_with("//") { String::new() } else { line.to_owned() };
    text[..tests].lines().map(line).collect::<Vec<_>>().join("\n")
}

/// Returns the modules of the crate that a text names, with their lines: `crate::a::b`, `crate::{a::b, c}`.
fn imports(text: &str) -> Vec<(usize, String)> {
    let word = |text: &str| text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut found = Vec::new();
    for (start, path) in text.match_indices("crate::").chain(text.match_indices("grimace::")) {
        let before = text[..start].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == '$') {
            continue;
        }
        let after = start + path.len();
        let line_of = |at: usize| text[..at].matches('\n').count() + 1;
        let Some(group) = text[after..].strip_prefix('{') else {
            found.push((line_of(start), word(&text[after..])));
            continue;
        };
        // Names are at the start of the group and after commas that are not in an inner group.
        let (mut depth, mut starts) = (1, vec![after + 1]);
        for (offset, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => starts.push(after + 2 + offset),
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
        let named = starts.into_iter().map(|at| (at + (text[at..].len() - text[at..].trim_start().len()), word(&text[at..])));
        found.extend(named.filter(|(_, name)| !name.is_empty()).map(|(at, name)| (line_of(at), name)));
    }
    found
}

/// Returns the forbidden imports in the text of a module.
fn wrong(module: &str, text: &str) -> Vec<(usize, String)> {
    let own = rank(module);
    let against = |(_, name): &(usize, String)| name != module && rank(name) > own;
    imports(&code(text)).into_iter().filter(against).collect()
}

fn check(module: &str, path: &Path, failures: &mut Vec<String>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).unwrap() {
            check(module, &entry.unwrap().path(), failures);
        }
    } else if path.extension().is_some_and(|e| e == "rs") && !path.file_stem().unwrap().to_string_lossy().ends_with("tests") {
        for (line, name) in wrong(module, &fs::read_to_string(path).unwrap()) {
            let path = path.strip_prefix(root()).unwrap().display();
            failures.push(format!("{path}:{line}: `{module}` imports `{name}`, which stands above it"));
        }
    }
}

#[test]
fn every_module_imports_only_what_lies_below_it() {
    let mut failures = Vec::new();
    for entry in fs::read_dir(root().join("src")).unwrap() {
        let path = entry.unwrap().path();
        let module = path.file_stem().unwrap().to_string_lossy().into_owned();
        if ["lib", "internal", "main", "bin"].contains(&module.as_str()) {
            continue;
        }
        if rank(&module).is_none() {
            failures.push(format!("src/{module}: give the module its place in LAYERS"));
        }
        check(&module, &path, &mut failures);
    }
    failures.sort();
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn a_wrong_import_is_found_and_named() {
    let text =
        "// use crate::cli;\nuse crate::{\n    units::{NodeId, Px},\n    report::Film,\n};\nfn f() { crate::pipeline::run(); }\n";
    let names = |module| wrong(module, text).into_iter().map(|(line, name)| format!("{line} {name}")).collect::<Vec<_>>();
    assert_eq!(names("fit"), ["4 report", "6 pipeline"]);
    assert_eq!(names("report"), ["6 pipeline"]);
    assert!(names("pipeline").is_empty());
    let tests = "use crate::units;\n#[cfg(test)]\nmod tests {\n    use crate::cli;\n}\n";
    assert!(wrong("fit", tests).is_empty());
}

/// Returns the names that the facade of a library exports, by module.
fn shown(text: &str) -> Vec<String> {
    let blocks = text.split("\nfacade! {\n").skip(1).filter_map(|block| block.split_once("\n}").map(|(block, _)| code(block)));
    let names = blocks.flat_map(|block| {
        let (module, shown) = block.split_once(':').expect("a module and its names");
        let module = module.trim().to_owned();
        let name = |part: &str| part.rsplit("::").next().map(str::trim).filter(|n| !n.is_empty()).map(str::to_owned);
        let names: Vec<String> = shown.split([',', '{', '}']).filter_map(name).collect();
        names.into_iter().map(move |name| format!("{module}::{name}"))
    });
    names.collect()
}

#[test]
fn the_facade_stays_small() {
    let shown = shown(&fs::read_to_string(root().join("src/lib.rs")).unwrap());
    assert!(shown.iter().any(|name| name == "fit::Fitter") && shown.iter().any(|name| name == "statistics::CompareOptions"));
    assert!((150..250).contains(&shown.len()), "{} names", shown.len());
    // No two items have the same name, and none has a name of Rust's prelude.
    let mut names: Vec<&str> = shown.iter().filter_map(|name| name.rsplit("::").next()).collect();
    names.sort_unstable();
    let doubled: Vec<&&str> = names.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| &pair[0]).collect();
    assert!(doubled.is_empty(), "two items are called {doubled:?}");
    let taken = ["Box", "Clone", "Copy", "Default", "Error", "Option", "Result", "String", "Vec"];
    assert!(names.iter().all(|name| !taken.contains(name)));
}

/// Collects the Rust files of a module: `NAME.rs`, and all files in the folder `NAME`.
fn sources(path: &Path, texts: &mut Vec<String>) {
    if path.is_dir() {
        fs::read_dir(path).unwrap().for_each(|entry| sources(&entry.unwrap().path(), texts));
    } else if path.extension().is_some_and(|e| e == "rs") {
        texts.push(fs::read_to_string(path).unwrap());
    }
}

/// Whether a text defines a public item of this name with a code block in its doc comment.
fn has_example(text: &str, name: &str) -> bool {
    let lines: Vec<&str> = text.lines().collect();
    let defines = |line: &str| {
        let Some(rest) = line.strip_prefix("pub ") else { return false };
        let Some((kind, rest)) = rest.split_once(' ') else { return false };
        let after = rest.strip_prefix(name).map(|after| after.starts_with(|c: char| c.is_alphanumeric() || c == '_'));
        ["const", "enum", "fn", "struct", "trait", "type"].contains(&kind) && after == Some(false)
    };
    let is_documented = |at: usize| {
        // Attributes may have several lines.
        let above = lines[..at].iter().rev().skip_while(|line| !line.starts_with("///") && !line.trim().is_empty());
        above.take_while(|line| line.starts_with("///")).any(|line| line.starts_with("/// ```"))
    };
    (0..lines.len()).any(|at| defines(lines[at]) && is_documented(at))
}

#[test]
fn every_name_of_the_facade_has_an_example() {
    let mut all = Vec::new();
    sources(&root().join("src"), &mut all);
    let lacks_example = |shown: &String| {
        let (module, name) = shown.split_once("::").unwrap();
        let mut texts = Vec::new();
        let file = root().join("src").join(format!("{module}.rs"));
        [file, root().join("src").join(module)].iter().filter(|path| path.exists()).for_each(|path| sources(path, &mut texts));
        // A module also shows items of others.
        !texts.iter().chain(&all).any(|text| has_example(text, name))
    };
    let shown = shown(&fs::read_to_string(root().join("src/lib.rs")).unwrap());
    let bare: Vec<String> = shown.into_iter().filter(lacks_example).collect();
    assert!(bare.is_empty(), "no code block in the doc comment of {}", bare.join(", "));
}

#[test]
fn an_item_without_an_example_is_found() {
    let text = "/// One.\n///\n/// ```\n/// f();\n/// ```\n#[must_use]\npub fn one() {}\n\n/// Two.\npub struct Two;\n";
    assert!(has_example(text, "one") && !has_example(text, "Two"));
    // Neither the beginning of a name nor a missing item counts.
    assert!(!has_example(text, "on") && !has_example(text, "three"));
}

/// Types of other crates that the facade's signatures may name.
const FOREIGN: &[&str] = &[
    "Arc",
    "AsRef",
    "AtomicBool",
    "BTreeMap",
    "BTreeSet",
    "Borrow",
    "Box",
    "Clone",
    "Debug",
    "DoubleEndedIterator",
    "Duration",
    "Err",
    "Error",
    "ExactSizeIterator",
    "Fn",
    "FnMut",
    "FnOnce",
    "Formatter",
    "GrayImage",
    "Hash",
    "ImageError",
    "Into",
    "IntoIterator",
    "Item",
    "Iterator",
    "Matrix2",
    "Matrix3",
    "Option",
    "Ordering",
    "Output",
    "Path",
    "PathBuf",
    "Point2",
    "Point3",
    "RangeInclusive",
    "Result",
    "RgbImage",
    "Rotation3",
    "Self",
    "Send",
    "Some",
    "String",
    "Sync",
    "Target",
    "Vec",
    "Vector2",
    "Vector3",
    "Write",
];

/// Returns the types that a signature or a field names: words with a capital first and a small letter.
fn types(text: &str) -> impl Iterator<Item = &str> {
    let words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.filter(|word| word.starts_with(char::is_uppercase) && word.contains(char::is_lowercase))
}

/// Returns the types without a page that the public items of a file show, each with its item: in fields, variants, functions and methods of
/// what `is_shown`, except for those with `#[doc(hidden)]`. It reads lines as rustfmt leaves them.
fn without_page(text: &str, is_shown: impl Fn(&str) -> bool) -> Vec<String> {
    let word = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let text = code(text);
    let (mut found, mut owner) = (Vec::new(), None::<(String, &str)>);
    let (mut is_hidden, mut in_attribute) = (false, false);
    // A signature of several lines.
    let mut open: Option<(String, String)> = None;
    let mut look = |item: &str, text: &str| {
        let pageless = types(text).filter(|name| !is_shown(name) && !FOREIGN.contains(name));
        found.extend(pageless.map(|name| format!("{item}: {name}")));
    };
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let indent = line.len() - line.trim_start().len();
        let line = line.trim_start();
        if let Some((item, start)) = open.take() {
            let whole = format!("{start} {line}");
            if line.ends_with(['{', ';', '}']) {
                look(&item, &whole)
            } else {
                open = Some((item, whole))
            }
            continue;
        }
        if in_attribute || line.starts_with("#[") {
            is_hidden |= line == "#[doc(hidden)]";
            in_attribute = !line.ends_with(']');
            continue;
        }
        let was_hidden = std::mem::take(&mut is_hidden);
        let public = line.strip_prefix("pub ").map(|rest| rest.strip_prefix("const ").unwrap_or(rest));
        let (kind, rest) =
            public.or_else(|| line.starts_with("impl").then_some(line)).and_then(|l| l.split_once(' ')).unwrap_or_default();
        let name = match kind.split('<').next() {
            _ if indent > 0 => String::new(),
            Some("impl") if !line.contains(" for ") => word(line.rsplit_once("> ").map_or(rest, |(_, after)| after)),
            Some("struct" | "enum" | "trait" | "fn") => word(rest),
            _ => String::new(),
        };
        if indent == 0 {
            let kind = if kind.starts_with("impl") { "impl" } else { kind };
            owner = (is_shown(&name) && !was_hidden).then_some((name, kind));
        }
        let Some((name, place)) = &owner else { continue };
        let signature = match (*place, indent) {
            ("fn", 0) => line,
            ("impl", 4) if kind == "fn" => rest,
            ("trait", 4) => line.strip_prefix("fn ").unwrap_or_default(),
            ("struct", 4) => public.and_then(|field| field.split_once(": ")).map_or("", |(_, field)| field),
            ("enum", 4) => line.split_once('(').map_or("", |(_, fields)| fields),
            ("enum", 8) => line.split_once(": ").map_or("", |(_, field)| field),
            _ => "",
        };
        let is_fn = matches!((*place, indent), ("fn", 0) | ("impl" | "trait", 4));
        if !was_hidden && is_fn && !signature.is_empty() && !line.ends_with(['{', ';', '}']) {
            open = Some((name.clone(), signature.to_owned()));
        } else if !was_hidden {
            look(name, if is_fn { signature.split(" {").next().unwrap_or_default() } else { signature });
        }
    }
    found
}

#[test]
fn every_type_that_the_facade_shows_has_a_page() {
    let shown = shown(&fs::read_to_string(root().join("src/lib.rs")).unwrap());
    let names: Vec<&str> = shown.iter().filter_map(|name| name.rsplit("::").next()).collect();
    let mut failures = Vec::new();
    for module in shown.iter().filter_map(|name| name.split("::").next()).collect::<std::collections::BTreeSet<_>>() {
        let mut texts = Vec::new();
        let file = root().join("src").join(format!("{module}.rs"));
        [file, root().join("src").join(module)].iter().filter(|path| path.exists()).for_each(|path| sources(path, &mut texts));
        texts.iter().for_each(|text| failures.extend(without_page(text, |name| names.contains(&name))));
    }
    failures.sort();
    assert!(failures.is_empty(), "make it private, or add it to the facade:\n{}", failures.join("\n"));
}

#[test]
fn a_type_without_a_page_is_found() {
    let text = "pub struct Shown {\n    /// Doc.\n    pub one: Vec<Secret>,\n    #[doc(hidden)]\n    pub two: Other,\n    three: Third,\n}\n\n\
                impl<'a> Shown {\n    pub fn four(\n        &self,\n    ) -> Option<Fourth> {\n        Fifth::new()\n    }\n}\n\n\
                pub enum Hidden {\n    Six(Sixth),\n}\n\npub fn make() -> Seventh {\n    Eighth\n}\n";
    let is_shown = |name: &str| ["Shown", "make"].contains(&name);
    assert_eq!(without_page(text, is_shown), ["Shown: Secret", "Shown: Fourth", "make: Seventh"]);
}
