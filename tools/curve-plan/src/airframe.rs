//! The vehicle that a route is checked for: `quad` or `plane` with PX4's defaults, or a vehicle file.
//!
//! A vehicle file is a TOML file of PX4's parameter names, or a `.params` file as QGroundControl and PX4 save it.
//! Both name the type of the vehicle by `MAV_TYPE`; a parameter that they do not name has PX4's default. The other
//! parameters of a `.params` file are ignored, since it has all of the vehicle's; in a TOML file, which is written
//! for this program, an unknown key is an error.

use std::path::{Path, PathBuf};

use curve_paths::flight::{Airframe, FixedWing, Multicopter, ParameterError};

use crate::failure::Failure;

/// The value of `--airframe`.
#[derive(Clone, Debug)]
pub(crate) enum Vehicle {
    /// A multicopter with PX4's defaults.
    Quad,
    /// A fixed wing with PX4's defaults.
    Plane,
    /// A vehicle file.
    File(PathBuf),
}

impl std::str::FromStr for Vehicle {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "quad" => Ok(Self::Quad),
            "plane" => Ok(Self::Plane),
            file if ending(Path::new(file)).is_some() => Ok(Self::File(file.into())),
            _ => Err("expected quad, plane, or a vehicle file: .toml or .params".into()),
        }
    }
}

impl Vehicle {
    /// The airframe.
    ///
    /// # Errors
    /// The file cannot be read, or a value in it is not usable.
    pub(crate) fn airframe(&self) -> Result<Airframe, Failure> {
        match self {
            Self::Quad => Ok(Airframe::Multicopter(Multicopter::default())),
            Self::Plane => Ok(Airframe::FixedWing(FixedWing::default())),
            Self::File(file) => read(file),
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Toml,
    Params,
}

fn ending(file: &Path) -> Option<Format> {
    match file.extension()?.to_str()? {
        "toml" => Some(Format::Toml),
        "params" => Some(Format::Params),
        _ => None,
    }
}

/// A value of the file: where it is, its name, the value.
type Named = (String, String, f64);

fn read(file: &Path) -> Result<Airframe, Failure> {
    let text = std::fs::read_to_string(file).map_err(|e| Failure::file(file, e))?;
    let format = ending(file).unwrap_or(Format::Toml);
    let values = match format {
        Format::Toml => toml(&text),
        Format::Params => params(&text),
    };
    let values = values.map_err(|problem| Failure::file(file, problem))?;
    airframe(&values, format).map_err(|problem| Failure::file(file, problem))
}

fn airframe(values: &[Named], format: Format) -> Result<Airframe, String> {
    let kind = values.iter().find(|(_, name, _)| name == TYPE);
    let Some((place, _, kind)) = kind else {
        return Err(format!("{TYPE} is missing, expected {TYPES}"));
    };
    let mut airframe = match *kind {
        // MAV_TYPE_FIXED_WING, and the VTOL types.
        k if k == 1.0 || (19.0..=25.0).contains(&k) && k.fract() == 0.0 => {
            Airframe::FixedWing(FixedWing::default())
        }
        // MAV_TYPE_QUADROTOR, COAXIAL, HEXAROTOR, OCTOROTOR, TRICOPTER.
        k if [2.0, 3.0, 13.0, 14.0, 15.0].contains(&k) => {
            Airframe::Multicopter(Multicopter::default())
        }
        other => return Err(format!("{place}: {TYPE} is {other}, expected {TYPES}")),
    };
    for (place, name, value) in values.iter().filter(|(_, name, _)| name != TYPE) {
        match airframe.set(name, *value) {
            Ok(()) => {}
            Err(ParameterError::Unknown(_)) if format == Format::Params => {}
            Err(fault) => return Err(format!("{place}: {fault}")),
        }
    }
    Ok(airframe)
}

fn toml(text: &str) -> Result<Vec<Named>, String> {
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| e.to_string())?;
    let number = |(name, value): (&String, &toml::Value)| {
        let found = match value {
            toml::Value::Integer(whole) => Some(*whole as f64),
            toml::Value::Float(number) => Some(*number),
            _ => None,
        };
        let place = format!("key {name}");
        found
            .map(|number| (place.clone(), name.clone(), number))
            .ok_or_else(|| format!("{place}: {value}, expected a number"))
    };
    table.iter().map(number).collect()
}

/// System, component, name, value and type, with tabs between them.
fn params(text: &str) -> Result<Vec<Named>, String> {
    let lines = text.lines().enumerate();
    let lines = lines.filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let named = |(index, line): (usize, &str)| {
        let place = format!("line {}", index + 1);
        let mut fields = line.split_whitespace().skip(2);
        let (Some(name), Some(value)) = (fields.next(), fields.next()) else {
            return Err(format!(
                "{place}: \"{line}\", expected system, component, name, value and type, with tabs between them"
            ));
        };
        let number = value
            .parse()
            .map_err(|_| format!("{place}: {name} is \"{value}\", expected a number"))?;
        Ok((place, name.to_owned(), number))
    };
    lines.map(named).collect()
}

const TYPE: &str = "MAV_TYPE";
const TYPES: &str =
    "1 (fixed wing), 19 to 25 (VTOL, on its wings) or 2, 3, 13, 14, 15 (multicopter)";
