//! Private messages of this project in Edition 2.5, which reserves 2000 to 2399 for them: parameters, with the
//! content of 50010 to 50012.
//!
//! There are no fields for a range, since each field is always sent and 0 would be a range: #1300 and #1301 give the
//! ranges of controls.

use super::rows::messages;
use crate::ed25::values::PARAMETER_KIND;
use crate::field::Wire::{Char, F64, I32, U8, U16};

messages! {
    ParameterRequest = 2010, "Parameter Request"
        sent(ToVsm, Push) latency_ms(1000) loi(&[2, 3, 4])
        text("private", "this project") ed4(&[50010])
        note("answered by #2012: one parameter, or all if no name is given")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("2010.01"), unit("s since 1970"), ed4(50010, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("2010.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("2010.03"), identification();
        parameter_name: Char(17) = 4, "Parameter Name", uid("2010.04"), ed4(50010, 2), note("empty: all");
    }

    ParameterSetCommand = 2011, "Parameter Set Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[4])
        text("private", "this project") ed4(&[50011])
        note("answered by #2012 once the vehicle reports the new value; fields from 11 on, in #1200 to #1303, are the vehicle's controls")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("2011.01"), unit("s since 1970"), ed4(50011, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("2011.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("2011.03"), identification();
        parameter_name: Char(17) = 4, "Parameter Name", uid("2011.04"), ed4(50011, 2);
        commanded_value: F64 = 5, "Commanded Value",
            uid("2011.05"), ed4(50011, 3), note("a whole number where the parameter is an integer");
    }

    ParameterReport = 2012, "Parameter Report"
        sent(ToCucs, Pull) latency_ms(1000) loi(&[2, 3, 4])
        text("private", "this project") ed4(&[50012])
        note("in answer to #2010 and #2011, and on a change to those that requested the parameter or are offered it as a control")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("2012.01"), unit("s since 1970"), ed4(50012, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("2012.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("2012.03"), identification();
        parameter_name: Char(17) = 4, "Parameter Name", uid("2012.04"), ed4(50012, 2);
        parameter_kind: U8 = 5, "Parameter Kind", uid("2012.05"), values(&PARAMETER_KIND), ed4(50012, 3);
        value: F64 = 6, "Value", uid("2012.06"), ed4(50012, 4);
        parameter_index: U16 = 7, "Parameter Index",
            uid("2012.07"), ed4(50012, 7), note("within an answer that lists all parameters, from 0");
        parameter_count: U16 = 8, "Parameter Count",
            uid("2012.08"), ed4(50012, 8), note("number of parameters in an answer that lists all; else 0");
    }
}
