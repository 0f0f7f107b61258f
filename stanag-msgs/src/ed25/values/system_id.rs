//! Values of connection and identity.

use super::values;

values! {
    LOI_BITMAP = "loi_bitmap", Bitmap, "0 means unspecified (#1), not authorised (#21.6) or not applicable (#21.7)" {
        0x01 LOI_2 "LOI 2";
        0x02 LOI_3 "LOI 3";
        0x04 LOI_4 "LOI 4";
        0x08 LOI_5 "LOI 5";
    }

    STATION_BITMAP = "station_bitmap", Bitmap, "bit k = payload station k + 1; 0 means no change (#1, #21) or not applicable" {
        0x0001 STATION_1 "station 1";
        0x0002 STATION_2 "station 2";
        0x0004 STATION_3 "station 3";
        0x0008 STATION_4 "station 4";
        0x0010 STATION_5 "station 5";
        0x0020 STATION_6 "station 6";
        0x0040 STATION_7 "station 7";
        0x0080 STATION_8 "station 8";
        .. "0x00000100..0x80000000" "station 9 to 32 ('etc.')";
    }

    REQUESTED_ACCESS = "requested_access", Enumeration, "Controlled Station Mode of #1" {
        0 RelinquishOrHandOff "relinquish or hand off";
        1 RequestControl "request control";
        2 OverrideControl "override control";
    }

    ACCESS_GRANTED = "access_granted", Enumeration, "Controlled Station Mode of #21" {
        0 NotInControl "not in control";
        1 InControl "in control";
    }

    WAIT_TRANSITION = "wait_transition", Enumeration, "" {
        0 DoNotWait "do not wait";
        1 WaitFor600 "wait for #600";
    }

    COUNTRY_CODE = "country_code", Enumeration, "table B1-1: first octet of every id; 1-99 NATO members and assets, 100-200 partners, 255 reserved (broadcast and null ids), 0 = logical ids" {
        1 NATOAsset "NATO asset";
        2 BEL "BEL";
        3 BGR "BGR";
        4 CAN "CAN";
        5 CZE "CZE";
        6 DNK "DNK";
        7 EST "EST";
        8 FRA "FRA";
        9 DEU "DEU";
        10 GRC "GRC";
        11 HUN "HUN";
        12 ISL "ISL";
        13 ITA "ITA";
        14 LVA "LVA";
        15 LTU "LTU";
        16 LUX "LUX";
        17 NLD "NLD";
        18 NOR "NOR";
        19 POL "POL";
        20 PRT "PRT";
        21 ROU "ROU";
        22 SVK "SVK";
        23 SVN "SVN";
        24 ESP "ESP";
        25 TUR "TUR";
        26 GBR "GBR";
        27 USA "USA";
        100 ALB "ALB";
        101 ARM "ARM";
        102 AUT "AUT";
        103 AZE "AZE";
        104 BLR "BLR";
        105 HRV "HRV";
        106 FIN "FIN";
        107 GEO "GEO";
        108 IRL "IRL";
        109 KAZ "KAZ";
        110 KGZ "KGZ";
        111 MDA "MDA";
        112 RUS "RUS";
        113 SWE "SWE";
        114 CHE "CHE";
        115 TJK "TJK";
        116 TKM "TKM";
        117 UKR "UKR";
        118 UZB "UZB";
        119 FYRNorthMacedonia "FYR (North Macedonia)";
    }

    VEHICLE_TYPE = "vehicle_type", Enumeration, "table B1-10; the custodian keeps the current list" {
        0 NotIdentified "not identified";
        1 BAMSUAV "BAMS UAV";
        2 Crecerelle "Crecerelle";
        3 CrecerelleGE "Crecerelle GE";
        4 Eagle1 "Eagle-1";
        5 RQ8FireScout "RQ-8 Fire Scout";
        6 RQ4AGlobalHawkA "RQ-4A Global Hawk A";
        7 Grasshopper "Grasshopper";
        8 MoyenDuc "Moyen Duc";
        9 PetitDuc "Petit Duc";
        10 Phoenix "Phoenix";
        11 MQ1PredatorA "MQ-1 Predator A";
        12 MQ9PredatorB "MQ-9 Predator B";
        13 Ranger "Ranger";
        14 RQ7Shadow200 "RQ-7 Shadow 200";
        15 Sperwer "Sperwer";
        16 SperwerLE "Sperwer LE";
        17 RQ2BPioneer "RQ-2B Pioneer";
        18 EagleEye "Eagle Eye";
        19 RQ5Hunter "RQ-5 Hunter";
        20 GHMDNavy "GHMD (Navy)";
        21 Mucke "Mucke";
        22 Luna "Luna";
        23 KZO "KZO";
        24 Taifun "Taifun";
        25 Fledermaus "Fledermaus";
        26 Falco "Falco";
        27 Nibbo "Nibbo";
        28 Hermes180 "Hermes 180";
        29 Hermes450 "Hermes 450";
        30 RQ4BGlobalHawkB "RQ-4B Global Hawk B";
        31 WarriorArmy "Warrior (Army)";
        32 ScanEagleA15 "ScanEagle A15";
        33 Vigilante496 "Vigilante 496";
        34 Vigilante502 "Vigilante 502";
        35 CamCopterS100 "CamCopter S100";
        36 LittleBird "Little Bird";
        37 Neuron "Neuron";
        38 TierIIUSMC "Tier II (USMC)";
        39 DragonEye "Dragon Eye";
        40 SilverFox "Silver Fox";
        41 SkyLark "SkyLark";
        42 Kestrel "Kestrel";
        43 Voyeur "Voyeur";
        44 Coyote "Coyote";
        45 FCSClassI "FCS Class I";
        46 FCSClassII "FCS Class II";
        47 FCSClassIII "FCS Class III";
        48 RavenB "Raven-B";
        49 Spyhawk "Spyhawk";
        50 Wasp "Wasp";
        51 Puma "Puma";
        52 Aerosonde "Aerosonde";
        53 ScanEagleA20 "ScanEagle A20";
        54 SkyX "Sky-X";
        55 Lince "Lince";
        56 Cobra "Cobra";
        .. "57-216" "reserved";
    }
}
