//! `[[vehicle]] count`: many vehicles of one table. Behind this file each is a vehicle like any other.

use std::path::PathBuf;

use stanag_msgs::Id;
use toml::Spanned;

use super::error::{Fault, fault};
use super::value::Signing;
use super::vehicle::{MIN_RATE_BPS, Vehicle};

/// The vehicles that the tables of a file are for, each at the place of its table.
///
/// # Errors
/// Ids or system ids cannot be counted so far, or vehicles would share a key or tail number, or have too little of
/// a slow link.
pub(super) fn expand(tables: Vec<Spanned<Vehicle>>) -> Result<Vec<Spanned<Vehicle>>, Fault> {
    let mut vehicles = Vec::with_capacity(tables.len());
    for table in tables {
        let span = table.span();
        let vehicle = table.into_inner();
        let Some(count) = vehicle.count else {
            vehicles.push(Spanned::new(span, vehicle));
            continue;
        };
        check(&vehicle, count, span.start)?;
        // Checked: none of them leaves its range.
        let nth = |n: u8| Vehicle {
            id: Id(vehicle.id.0 + u32::from(n)),
            logical_id: vehicle.logical_id.map(|id| Id(id.0 + u32::from(n))),
            system_id: vehicle.system_id + n,
            tail_number: numbered(&vehicle.tail_number, n),
            // They share what the link carries: the whole of it for each would fill a radio until nothing gets through.
            rate_bps: vehicle.rate_bps.map(|rate| rate / u32::from(count)),
            signing: match &vehicle.signing {
                Signing::KeyFile(file, exchange) => {
                    Signing::KeyFile(numbered_file(file, n), *exchange)
                }
                Signing::Off => Signing::Off,
            },
            count: None,
            ..vehicle.clone()
        };
        vehicles.extend((0..count).map(|n| Spanned::new(span.clone(), nth(n))));
    }
    Ok(vehicles)
}

fn check(vehicle: &Vehicle, count: u8, at: usize) -> Result<(), Fault> {
    let Some(further) = count.checked_sub(1) else {
        return fault(at, "vehicle.count", count, "1 to 255");
    };
    if vehicle.system_id.checked_add(further).is_none() {
        let expected = format!(
            "at most {}: system ids are counted up from {} to 255; others need a link, and a [[vehicle]], of their own",
            256 - u16::from(vehicle.system_id),
            vehicle.system_id
        );
        return fault(at, "vehicle.count", count, &expected);
    }
    let ids = [("id", Some(vehicle.id)), ("logical_id", vehicle.logical_id)];
    for (name, first) in ids {
        let Some(first) = first else {
            continue;
        };
        // The first byte is the owner's, or that of logical ids.
        let last = (first.0 & OF_OWNER) + u32::from(further);
        if last > OF_OWNER {
            let expected = format!(
                "fewer: counted up from the {name} {first}, the last one would not be of the same owner"
            );
            return fault(at, "vehicle.count", count, &expected);
        }
    }
    if further == 0 {
        return Ok(());
    }
    let least = u32::from(count) * MIN_RATE_BPS;
    if let Some(rate) = vehicle.rate_bps.filter(|rate| *rate < least) {
        let expected = format!("{least} or more: {MIN_RATE_BPS} bits a second for each of {count}");
        return fault(at, "vehicle.rate_bps", rate, &expected);
    }
    if let Signing::KeyFile(file, _) = &vehicle.signing
        && !file.to_string_lossy().contains(NUMBER)
    {
        let expected = "a name with {n}, in place of which the numbers from 1 stand, such as \"uav{n}.key\": each vehicle has \
                        a key of its own";
        return fault(at, "vehicle.signing.key_file", file.display(), expected);
    }
    if !vehicle.tail_number.is_empty() && !vehicle.tail_number.contains(NUMBER) {
        let expected = "a tail number with {n}, in place of which the numbers from 1 stand, such as \"UAV-{n}\"";
        return fault(at, "vehicle.tail_number", &vehicle.tail_number, expected);
    }
    Ok(())
}

fn numbered(text: &str, n: u8) -> String {
    text.replace(NUMBER, &(u16::from(n) + 1).to_string())
}

/// A name that is not Unicode has no number: it stays as it is.
fn numbered_file(file: &std::path::Path, n: u8) -> PathBuf {
    file.to_str()
        .map_or_else(|| file.to_owned(), |text| numbered(text, n).into())
}

/// Stands for the number of a vehicle, from 1.
const NUMBER: &str = "{n}";
/// The bytes of an id behind that of its owner.
const OF_OWNER: u32 = 0x00ff_ffff;

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::Config;

    fn file(vehicles: &str) -> String {
        format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:4586\"\n[store]\ndir = \"state\"\n{vehicles}"
        )
    }

    fn table(more: &str) -> String {
        file(&format!(
            "[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:14550\"\n{more}\n"
        ))
    }

    fn parse(text: &str) -> Result<Config, String> {
        Config::parse(text, Path::new("/etc/vsm")).map_err(|fault| fault.to_string())
    }

    /// What differs between the vehicles, one a line.
    fn listed(config: &Config) -> Vec<String> {
        let vehicles = config.vehicles();
        let each = vehicles.map(|one| {
            let (id, system, tail) = (one.id, one.system_id, &one.tail_number);
            format!("{id} {system} {tail} {:?}", one.signing)
        });
        each.collect()
    }

    #[test]
    fn a_counted_table_is_the_same_as_a_table_for_each() {
        let counted = table(
            "system_id = 9\ncount = 3\ntail_number = \"UAV-{n}\"\nsigning = { key_file = \"keys/{n}.key\" }\nagl = \"refuse\"",
        );
        let each = (1..=3).map(|n| {
            format!(
                "[[vehicle]]\nid = \"1b:00:01:0{n}\"\nlink = \"udpin:127.0.0.1:14550\"\nsystem_id = {}\ntail_number = \
                 \"UAV-{n}\"\nsigning = {{ key_file = \"keys/{n}.key\" }}\nagl = \"refuse\"\n",
                8 + n
            )
        });
        let each = file(&each.collect::<String>());
        let (counted, each) = (parse(&counted).unwrap(), parse(&each).unwrap());
        assert_eq!(listed(&counted), listed(&each));
        assert_eq!(counted.links().len(), 1);
        // A file that says the same in other words changes nothing of a running bridge.
        let report = each.changes(&counted).unwrap().report;
        assert_eq!((report.applied, report.restart), (vec![], vec![]));
    }

    #[test]
    fn another_count_adds_and_removes_vehicles_of_a_running_bridge() {
        let of = |count: u8| {
            parse(&table(&format!(
                "system_id = 1\ncount = {count}\nsigning = {{ key_file = \"{{n}}.key\" }}"
            )))
            .unwrap()
        };
        let report = of(3).changes(&of(4)).unwrap().report;
        assert_eq!(report.applied, ["vehicle 1b:00:01:04 added"]);
        let report = of(3).changes(&of(2)).unwrap().report;
        assert_eq!(report.applied, ["vehicle 1b:00:01:03 removed"]);
    }

    #[test]
    fn a_thousand_vehicles_are_four_tables() {
        let tables = (0..4).map(|n| {
            format!(
                "[[vehicle]]\nid = \"1b:00:1{n}:00\"\nlink = \"udpin:127.0.0.1:1455{n}\"\nsystem_id = 1\ncount = 244\n\
                 signing = {{ key_file = \"{n}-{{n}}.key\" }}\n"
            )
        });
        let config = parse(&file(&tables.collect::<String>())).unwrap();
        assert_eq!(config.vehicles().count(), 976);
        assert_eq!(config.links().len(), 4);
    }

    #[test]
    fn counted_vehicles_share_what_their_link_carries() {
        let config = parse(&table(
            "system_id = 1\ncount = 3\nrate_bps = 57600\nsigning = { key_file = \"{n}.key\" }",
        ));
        let rates: Vec<_> = config.unwrap().vehicles().map(|one| one.rate_bps).collect();
        assert_eq!(rates, [Some(19_200); 3]);
    }

    #[test]
    fn what_cannot_be_counted_is_refused_by_name_and_line() {
        let key = "signing = { key_file = \"{n}.key\" }";
        let second = format!(
            "\n[[vehicle]]\nid = \"1b:00:01:03\"\nlink = \"udpin:127.0.0.1:14551\"\nsystem_id = 1\n{key}"
        );
        for (more, parts) in [
            (
                format!("system_id = 1\ncount = 0\n{key}"),
                ["line 10: vehicle.count is 0", "1 to 255"],
            ),
            (
                format!("system_id = 250\ncount = 7\n{key}"),
                ["line 10: vehicle.count is 7", "at most 6"],
            ),
            // The VSM's own is among them.
            (
                format!("system_id = 240\ncount = 6\n{key}"),
                ["line 9: vehicle.system_id is 245", "mavlink.system_id"],
            ),
            (
                "system_id = 1\ncount = 2\nsigning = { key_file = \"one.key\" }".to_owned(),
                ["line 11: vehicle.signing.key_file is one.key", "uav{n}.key"],
            ),
            (
                format!("system_id = 1\ncount = 3\nrate_bps = 28799\n{key}"),
                ["line 11: vehicle.rate_bps is 28799", "28800 or more"],
            ),
            (
                format!("system_id = 1\ncount = 2\n{key}\ntail_number = \"UAV\""),
                ["line 12: vehicle.tail_number is UAV", "UAV-{n}"],
            ),
            // The id of another table is among those that are counted, in either order.
            (
                format!("system_id = 1\ncount = 3\n{key}{second}"),
                ["line 13: vehicle.id is 1b:00:01:03", "nothing else"],
            ),
            (
                format!(
                    "system_id = 5\n{key}{}\ncount = 300",
                    second.replace("14551", "14550")
                ),
                ["line 16: vehicle.count", "expected"],
            ),
            (
                format!(
                    "system_id = 5\n{key}{}\ncount = 6",
                    second.replace("14551", "14550")
                ),
                [
                    "vehicle.system_id is 5 twice on udpin:127.0.0.1:14550",
                    "of its own",
                ],
            ),
            (
                format!("system_id = 1\nlogical_id = \"00:ff:ff:f0\"\ncount = 20\n{key}"),
                ["line 11: vehicle.count is 20", "logical_id 00:ff:ff:f0"],
            ),
        ] {
            let fault = parse(&table(&more)).expect_err(&more);
            for part in parts {
                assert!(fault.contains(part), "{part:?} not in {fault}\n{more}");
            }
        }
        let owner = table(&format!("system_id = 1\ncount = 20\n{key}"));
        let fault = parse(&owner.replace("1b:00:01:01", "1b:ff:ff:f0")).expect_err("another owner");
        assert!(fault.contains("line 10: vehicle.count is 20"), "{fault}");
    }

    #[test]
    fn one_counted_vehicle_has_the_number_1_and_without_count_a_name_is_as_it_stands() {
        let with = |count: &str| {
            let text = table(&format!(
                "system_id = 1\ntail_number = \"UAV-{{n}}\"\nsigning = \"off\"\n{count}"
            ));
            let config = parse(&text).unwrap();
            config.vehicles().next().unwrap().tail_number.clone()
        };
        assert_eq!(with("count = 1"), "UAV-1");
        assert_eq!(with(""), "UAV-{n}");
    }
}
