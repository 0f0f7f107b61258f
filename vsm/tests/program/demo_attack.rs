//! `vsm demo --attack` shows what it promises: the vehicle that is not protected comes down, the other holds its altitude and is
//! landed by its own ground station; on the radio is nothing to read where it is encrypted.

use kit::process::run_in;

/// What is printed of an attack: without what stands against it, and with it.
fn flights<'a>(printed: &'a str, attack: &str) -> [&'a str; 2] {
    // The lines that were printed in flight name the attacks too.
    let summary = printed.find("\n\nposition commands").expect("the summary");
    let part = printed[summary..].split(attack).nth(1);
    let mut lines = part
        .unwrap_or_else(|| panic!("{attack}: {printed}"))
        .lines()
        .skip(1);
    ["  without ", "  with "].map(|word| {
        let line = lines.next().unwrap_or_default();
        assert!(line.starts_with(word), "{attack}: {line}");
        line
    })
}

/// The lowest altitude after the attack began, m.
fn lowest_m(flight: &str) -> f64 {
    let after = flight.split("lowest ").nth(1).expect(flight);
    let figure = after.split(' ').next().expect(flight);
    figure.parse().expect(flight)
}

fn holds(flight: &str) -> bool {
    lowest_m(flight) > 1.5 && flight.contains("landed by its own CUCS afterwards")
}

#[test]
fn false_data_bring_down_the_vehicle_that_is_not_protected_and_not_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let (done, printed) = run_in(
        folder.path(),
        "vsm",
        &["demo", "--attack", "--speed", "5", "--out", "out"],
    );
    let printed = String::from_utf8_lossy(&printed);
    assert!(done, "{printed}");
    for (attack, refused) in [
        ("position commands on the MAVLink link", "unsigned "),
        ("from another address", "guard: no trailer "),
        ("from its own address\n", "guard: no trailer "),
    ] {
        let [without, with] = flights(&printed, attack.trim_end());
        assert!(lowest_m(without) < 0.5, "{without}");
        assert!(without.contains("brought to the ground"), "{without}");
        assert!(holds(with), "{with}");
        assert!(with.contains(refused), "{with}");
    }
    let [without, with] = flights(&printed, "in a web client's name");
    assert!(without.contains("brought to the ground"), "{without}");
    assert!(holds(with) && with.contains("web: "), "{with}");
    let [without, with] = flights(&printed, "a recorded landing");
    assert!(holds(without) && holds(with), "{without}\n{with}");
    assert!(with.contains("guard: "), "{with}");

    let [without, with] = flights(&printed, "the radio between bridge and agent");
    let read = without.split(" datagrams, ").nth(1).expect(without);
    let positions: u32 = read.split(' ').next().unwrap().parse().expect(without);
    assert!(positions > 100, "{without}");
    assert!(with.contains(" 0 positions read"), "{with}");
    let clear = with.split("in the clear: ").nth(1).expect(with);
    // Keys are agreed in the clear, where that was not over before somebody listened. Nothing else is.
    let keys_alone = clear.ends_with(" KEY_EXCHANGE") && !clear.contains(',');
    assert!(clear.is_empty() || keys_alone, "in the clear: {clear}");

    let picture = std::fs::read_to_string(folder.path().join("out/attack.svg")).unwrap();
    assert_eq!(picture.matches("without ").count(), 6, "each has its line");
    // Two curves each, the last of which nothing was read for, and the dashed line of each attack.
    assert_eq!(picture.matches("<polyline").count(), 6 * 2 + 5);
}
