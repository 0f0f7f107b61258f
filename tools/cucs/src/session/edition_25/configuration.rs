//! Answers of the configuration phase (#1300 to #1303), as messages and fields of Edition 4.

use stanag_msgs::Message;
use stanag_msgs::ed25::{self, Record, Version};
use stanag_msgs::messages::{
    FieldConfigurationEnumeratedResponse, FieldConfigurationFloatResponse,
    FieldConfigurationIntegerResponse, FieldConfigurationUnsignedResponse,
    MessageParameterAvailability, ParameterSetCommand,
};
use stanag_msgs::table::Wire;

/// The answer, for a field that Edition 4 has as well.
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
        let mut answer = record.to_ed4(&MessageParameterAvailability::INFO).ok()?;
        answer.set(5, u32::from(message));
        answer.set(6, number);
        return answer.message().ok();
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
    let mut answer = if record.id() == 1302 {
        record.to_ed4(target).ok()?
    } else {
        bounds(record, target, message, number)
    };
    answer.set(7, u32::from(message));
    answer.set(8, number);
    answer.message().ok()
}

/// The answer for a control of the vehicle: a field of #2011 that the table does not have, so the message gives its
/// kind.
fn control(record: &Record, number: u8) -> Option<Message> {
    let (target, widest) = match record.id() {
        1300 => (
            &FieldConfigurationIntegerResponse::INFO,
            f64::from(i32::MAX),
        ),
        1301 => (&FieldConfigurationFloatResponse::INFO, f64::from(f32::MAX)),
        1303 => {
            let mut answer = record.to_ed4(&MessageParameterAvailability::INFO).ok()?;
            answer.set(5, u32::from(ParameterSetCommand::ID));
            answer.set(6, number);
            return answer.message().ok();
        }
        _ => return None,
    };
    let mut answer = bounds(record, target, ParameterSetCommand::ID, number);
    // The whole range of the type is not a limit.
    for bound in [11, 12] {
        if answer
            .number(bound)
            .is_some_and(|value| value.abs() >= widest)
        {
            answer.clear(bound);
        }
    }
    answer.set(7, u32::from(ParameterSetCommand::ID));
    answer.set(8, number);
    answer.message().ok()
}

/// The bounds in Edition 4 are in steps of its wire type.
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
    let mut answer = Record::new(target);
    for (of, at) in [(1, 1), (4, 2), (5, 3), (6, 4), (9, 9), (20, 21)] {
        if let Some(value) = record.number(of) {
            answer.set(at, value);
        }
    }
    for bound in 10..=18 {
        if let Some(value) = record.number(bound) {
            // The bounds have the same order, after Default Value.
            answer.set(bound + 1, steps(value));
        }
    }
    answer.set_text(20, record.text(19));
    answer
}

/// #2011 for 50011; fields from this number on are controls.
const PARAMETER_SET: u32 = 2011;
const FIRST_CONTROL: usize = 11;
