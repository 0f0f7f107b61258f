//! Answers of the configuration phase, by the messages and fields of Edition 4: #1300 to #1303.

use stanag_msgs::Message;
use stanag_msgs::ed25::{self, Record, Version};
use stanag_msgs::messages::{
    FieldConfigurationEnumeratedResponse, FieldConfigurationFloatResponse,
    FieldConfigurationIntegerResponse, FieldConfigurationUnsignedResponse,
    MessageParameterAvailability, ParameterSetCommand,
};
use stanag_msgs::table::Wire;

/// What it says of a field that Edition 4 has as well.
pub(super) fn answer(record: &Record) -> Option<Message> {
    let info = ed25::message(record.whole(7), Version::Ed25)?;
    let (message, number) = match record.whole(8) as usize {
        control @ FIRST_CONTROL.. if record.whole(7) == PARAMETER_SET => {
            return self::control(record, u8::try_from(control).ok()?);
        }
        0 => (*info.ed4_messages.first()?, 0),
        field => info.fields.get(field - 1)?.ed4?,
    };
    if record.id() == 1303 {
        let mut said = record.to_ed4(&MessageParameterAvailability::INFO).ok()?;
        said.set(5, u32::from(message));
        said.set(6, number);
        return said.message().ok();
    }
    let target = match record.id() {
        1302 => &FieldConfigurationEnumeratedResponse::INFO,
        _ => {
            let fields = ed25::record::ed4(message)?.fields;
            match fields.get(usize::from(number).checked_sub(1)?)?.wire {
                Wire::F32 | Wire::F64 => &FieldConfigurationFloatResponse::INFO,
                Wire::U8 | Wire::U16 | Wire::U24 | Wire::U32 | Wire::U40 => {
                    &FieldConfigurationUnsignedResponse::INFO
                }
                _ => &FieldConfigurationIntegerResponse::INFO,
            }
        }
    };
    let mut said = if record.id() == 1302 {
        record.to_ed4(target).ok()?
    } else {
        bounds(record, target, message, number)
    };
    said.set(7, u32::from(message));
    said.set(8, number);
    said.message().ok()
}

/// A control of the vehicle, a field of #2011 that the table does not have: its message names its kind.
fn control(record: &Record, number: u8) -> Option<Message> {
    let (target, widest) = match record.id() {
        1300 => (
            &FieldConfigurationIntegerResponse::INFO,
            f64::from(i32::MAX),
        ),
        1301 => (&FieldConfigurationFloatResponse::INFO, f64::from(f32::MAX)),
        1303 => {
            let mut said = record.to_ed4(&MessageParameterAvailability::INFO).ok()?;
            said.set(5, u32::from(ParameterSetCommand::ID));
            said.set(6, number);
            return said.message().ok();
        }
        _ => return None,
    };
    let mut said = bounds(record, target, ParameterSetCommand::ID, number);
    // All that the type holds is no limit.
    for bound in [11, 12] {
        if said
            .number(bound)
            .is_some_and(|value| value.abs() >= widest)
        {
            said.clear(bound);
        }
    }
    said.set(7, u32::from(ParameterSetCommand::ID));
    said.set(8, number);
    said.message().ok()
}

/// The bounds of Edition 4 are in steps of its wire.
fn bounds(
    record: &Record,
    target: &'static stanag_msgs::table::MessageInfo,
    message: u16,
    number: u8,
) -> Record {
    let field = ed25::record::ed4(message)
        .and_then(|info| info.fields.get(usize::from(number).checked_sub(1)?));
    let steps = |value: f64| match field.map(|field| (field.wire, field.step())) {
        None | Some((Wire::F32 | Wire::F64, _)) => value,
        Some((_, step)) => (value / step).round(),
    };
    let mut said = Record::new(target);
    for (of, at) in [(1, 1), (4, 2), (5, 3), (6, 4), (9, 9), (20, 21)] {
        if let Some(value) = record.number(of) {
            said.set(at, value);
        }
    }
    for bound in 10..=18 {
        if let Some(value) = record.number(bound) {
            // The same order, after Default Value.
            said.set(bound + 1, steps(value));
        }
    }
    said.set_text(20, record.text(19));
    said
}

/// #2011, for 50011; from this field on are controls.
const PARAMETER_SET: u32 = 2011;
const FIRST_CONTROL: usize = 11;
