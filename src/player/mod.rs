//! The player: motions on faces, on one self-contained page.
//!
//! A page holds motions ([`SourceMotion`]: representatives, tracks, FAP files) and faces ([`PlayerFace`]), and applies a motion to a face in the
//! browser. It places the nodes as `clone` does and moves the mesh of [`crate::warp`] with its weights, drawn with WebGL, or triangle by
//! triangle on a canvas. The page holds numbers and pictures (`payload`); the report uses the same scripts (`assets/`).

mod head;
mod names;
mod pack;
mod payload;

use minijinja::{
    Environment, UndefinedBehavior, context,
    syntax::SyntaxConfig,
    value::{Serde, Value},
};
use serde::Serialize;

pub use head::Head as PlayerHead;
pub use payload::{Face as PlayerFace, PlayerError, payload};

use crate::{
    clone::{Skin, SourceMotion},
    wireframe::Face,
};

const TEMPLATE: &str = include_str!("assets/player.html");
/// Style sheet of the player, for any page that contains one.
pub const STYLE: &str = include_str!("assets/player.css");
const PAGE_STYLE: &str = include_str!("assets/page.css");
const PAGE_SCRIPT: &str = include_str!("assets/page.js");
/// The parts of the player's script, in the order of their dependencies.
const SCRIPTS: [&str; 11] = [
    include_str!("assets/motion.js"),
    include_str!("assets/rig.js"),
    include_str!("assets/lids.js"),
    include_str!("assets/brows.js"),
    include_str!("assets/folds.js"),
    include_str!("assets/mixture.js"),
    include_str!("assets/head.js"),
    include_str!("assets/gl.js"),
    include_str!("assets/flat.js"),
    include_str!("assets/curves.js"),
    include_str!("assets/player.js"),
];

/// A motion with its label.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// Label, such as `happiness, sex = f`.
    pub label: &'a str,
    /// The motion.
    pub motion: &'a SourceMotion,
    /// The folds that grow with it.
    pub skin: &'a Skin,
}

#[derive(Serialize)]
struct View<'a> {
    title: &'a str,
    version: &'static str,
}

/// Renders the page with faces and dense heads.
///
/// Every text is escaped; the data is embedded as JSON in which `<` is written `\u003c`. The same input gives the same bytes.
///
/// # Errors
/// [`PlayerError`] for a motion without FAPs to show or a picture that cannot be encoded.
pub fn page(
    title: &str,
    motions: &[Shown],
    faces: &[PlayerFace],
    heads: &[PlayerHead],
    face: &Face,
) -> Result<String, PlayerError> {
    let mut data = payload(motions, faces, face)?;
    if let Some(list) = data["faces"].as_array_mut() {
        for dense in heads {
            list.push(head::payload(dense, motions)?);
        }
    }
    let render = || -> Result<String, minijinja::Error> {
        let mut environment = Environment::new();
        environment.set_undefined_behavior(UndefinedBehavior::Strict);
        environment.set_syntax(SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build()?);
        // The name ends in `.html`: minijinja escapes every value that is not marked safe.
        environment.add_template("player.html", TEMPLATE)?;
        environment.get_template("player.html")?.render(context! {
            page => Value::from(Serde(View { title, version: env!("CARGO_PKG_VERSION") })),
            payload => Value::from_safe_string(script_json(&data)),
            style => Value::from_safe_string(format!("{STYLE}{PAGE_STYLE}")),
            script => Value::from_safe_string(format!("{}{PAGE_SCRIPT}", script())),
        })
    };
    render().map_err(|e| PlayerError::Page(e.to_string()))
}

/// The player's script, for any page that contains a player; it defines only `GrimacePlayer`.
pub fn script() -> String {
    format!(
        "const GrimacePlayer = (() => {{\n{}\nreturn {{ mount: mountPlayer, Shelf, FacePlayer }};\n}})();\n",
        SCRIPTS.concat()
    )
}

/// Serializes JSON for a script element: `<` occurs inside strings only, where JSON allows the escape.
pub fn script_json(value: &serde_json::Value) -> String {
    value.to_string().replace('<', "\\u003c")
}
