//! Values of the configuration phase.

use super::values;

values! {
    SUBSYSTEM_ID_FIELD = "subsystem_id_field", Enumeration, "as subsystem_id, in the field configuration messages" {
        0 Engine "engine";
        1 Mechanical "mechanical";
        2 Electrical "electrical";
        3 Comms "comms";
        4 PropulsionEnergy "propulsion energy";
        5 Navigation "navigation";
        6 Payload "payload";
        7 RecoverySystem "recovery system";
        8 EnvironmentalControlSystem "environmental control system";
        9 VSMStatus "VSM status";
        10 ADT "ADT";
        11 GDT "GDT";
        19 NotAssigned "not assigned";
        .. "12-18" "reserved";
        .. "20-31" "VSM specific";
    }

    CONFIG_REQUEST_TYPE = "config_request_type", Enumeration, "" {
        0 SingleParameter "single parameter";
        1 LOI2 "LOI 2";
        2 LOI3 "LOI 3";
        3 LOI4 "LOI 4";
        4 LOI5 "LOI 5";
        5 DataLink "data link";
        6 AbortConfiguration "abort configuration";
    }

    SENSOR_SELECT = "sensor_select", Enumeration, "" {
        0 NA "N/A";
        1 Sensor1 "sensor 1";
        2 Sensor2 "sensor 2";
        3 Sensor3 "sensor 3";
    }

    UNIT_DISTANCE = "unit_distance", Enumeration, "" {
        0 Metres "metres";
        1 Feet "feet";
    }

    UNIT_SPEED = "unit_speed", Enumeration, "" {
        0 MS "m/s";
        1 Knots "knots";
        2 Mph "mph";
        3 KmH "km/h";
    }

    UNIT_POSITION = "unit_position", Enumeration, "" {
        0 Degrees "degrees";
        1 UTM "UTM";
        2 MGRS "MGRS";
    }

    UNIT_TEMPERATURE = "unit_temperature", Enumeration, "" {
        0 Centigrade "centigrade";
        1 Fahrenheit "fahrenheit";
    }

    UNIT_MASS = "unit_mass", Enumeration, "" {
        0 Kg "kg";
        1 Pounds "pounds";
    }

    UNIT_ANGLE = "unit_angle", Enumeration, "" {
        0 Radians "radians";
        1 Degrees "degrees";
    }

    UNIT_PRESSURE = "unit_pressure", Enumeration, "" {
        0 Mb "mb";
        1 InHg "inHg";
        2 Pa "Pa";
    }

    UNIT_FUEL = "unit_fuel", Enumeration, "" {
        0 Litres "litres";
        1 Pounds "pounds";
        2 Kg "kg";
    }

    RESOURCE_AVAILABLE = "resource_available", Enumeration, "" {
        1 Yes "yes";
    }

    FIELD_SUPPORTED = "field_supported", Enumeration, "" {
        0 NotSupported "not supported";
        1 Supported "supported";
    }

    FIELD_AVAILABLE = "field_available", Enumeration, "" {
        0 NotAvailableForSelection "not available for selection";
        1 AvailableForSelection "available for selection";
    }

    ENUM_INDEX_ENABLE = "enum_index_enable", Enumeration, "" {
        -2 NotImplemented "not implemented";
        -1 UnavailableForSelection "unavailable for selection";
        0 AvailableForSelection "available for selection";
    }
}
