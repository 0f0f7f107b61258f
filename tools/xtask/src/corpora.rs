//! `tests/fuzz/corpora`: what hours of fuzzing have found, in a few kilobytes of text for each target.
//!
//! Fuzzing leaves thousands of files. What is kept of them covers what the seeds do not: first the code that they do not
//! reach, then the rest of libFuzzer's features, which are how often each edge of the code is passed. Inputs that add most for each
//! byte come first, as long as there is room. A line is an input, in hexadecimal, shortest first: what is added or left out is a line of
//! the difference.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap, HashSet};
use std::fmt::Write as _;
use std::fs;

use anyhow::{Context as _, Result, bail};

/// What is kept of a target.
#[derive(Debug)]
pub(crate) struct Kept {
    /// Its file.
    pub(crate) text: String,
    /// What was found, and what is kept of it.
    pub(crate) summary: String,
}

/// Chooses what to keep of a target, of whose inputs `control` has the features: the file of libFuzzer's `-merge_control_file`, as
/// `-set_cover_merge=1` leaves it. Its first folder has the seeds.
///
/// # Errors
/// The file cannot be read, one that it names cannot, or an input has ended the target.
pub(crate) fn keep(target: &str, control: &str, longest: usize) -> Result<Kept> {
    let (seeds, found) = read(control, longest)?;
    let head = header(target);
    let chosen = choose(&seeds, &found, MAX_BYTES - head.len());
    let mut text = head;
    for input in &chosen {
        for byte in &input.bytes {
            let _ = write!(text, "{byte:02x}");
        }
        text.push('\n');
    }
    let summary = format!(
        "{target}: {} of {} inputs; edges covered: {} by the seeds, {} with what is kept, {} by all",
        chosen.len(),
        found.len(),
        edges(seeds.iter()),
        edges(seeds.iter().chain(chosen)),
        edges(seeds.iter().chain(&found)),
    );
    Ok(Kept { text, summary })
}

struct Input {
    bytes: Vec<u8>,
    features: Vec<u32>,
}

impl Input {
    /// Its line, in bytes.
    fn line(&self) -> usize {
        2 * self.bytes.len() + 1
    }
}

/// The seeds, and what was found, shortest first. The file has the number of inputs, that of the first folder, the inputs' paths, and
/// then, among others, a line `FT` for each with its number and its features.
fn read(control: &str, longest: usize) -> Result<(Vec<Input>, Vec<Input>)> {
    let mut lines = control.lines();
    let mut count = || -> Result<usize> {
        let line = lines.next().context("a control file without its counts")?;
        line.parse().with_context(|| format!("a count: {line}"))
    };
    let (all, first) = (count()?, count()?);
    let paths: Vec<&str> = lines.by_ref().take(all).collect();
    let mut features = BTreeMap::new();
    for line in lines {
        let Some(numbers) = line.strip_prefix("FT ") else {
            continue;
        };
        let numbers: Result<Vec<u32>, _> = numbers.split(' ').map(str::parse::<u32>).collect();
        let numbers = numbers.with_context(|| format!("features: {line}"))?;
        let [index, own @ ..] = &numbers[..] else {
            bail!("features of no input: {line}");
        };
        features.insert(usize::try_from(*index)?, own.to_vec());
    }
    let (mut seeds, mut found) = (Vec::new(), Vec::new());
    for (index, path) in paths.into_iter().enumerate() {
        let Some(features) = features.remove(&index) else {
            bail!("{path} ends the target: mend that first");
        };
        let mut bytes = fs::read(path).with_context(|| path.to_owned())?;
        // The target was given no more of it.
        bytes.truncate(longest);
        // Beside the seeds lies what was kept before: that has to be worth its place again.
        let seed = index < first
            && path
                .rsplit('/')
                .next()
                .is_some_and(|n| n.starts_with("seed-"));
        let input = Input { bytes, features };
        if seed {
            seeds.push(input);
        } else if !input.bytes.is_empty() {
            found.push(input);
        }
    }
    // The same whatever order the folders are read in.
    found.sort_by(by_length);
    found.dedup_by(|one, other| one.bytes == other.bytes);
    Ok((seeds, found))
}

/// Those of `found` that cover most beyond `seeds` in `room` bytes of text, shortest first.
fn choose<'a>(seeds: &[Input], found: &'a [Input], mut room: usize) -> Vec<&'a Input> {
    let mut chosen: Vec<&Input> = Vec::new();
    let steps: [fn(u32) -> u32; 2] = [edge, whole];
    for counted in steps {
        let mut so_far = covered(seeds.iter().chain(chosen.iter().copied()), counted);
        let worth = |input: &Input, so_far: &HashSet<u32>| {
            let own = input.features.iter().map(|feature| counted(*feature));
            // Each once: an edge has a feature for each number of times that it is passed.
            let new: HashSet<u32> = own.filter(|one| !so_far.contains(one)).collect();
            // Millionths for each byte.
            new.len() * 1_000_000 / input.line()
        };
        let inputs = found.iter().enumerate();
        let mut queue: BinaryHeap<(usize, Reverse<usize>)> = inputs
            .map(|(at, input)| (worth(input, &so_far), Reverse(at)))
            .collect();
        while let Some((_, Reverse(at))) = queue.pop() {
            let input = &found[at];
            let left = worth(input, &so_far);
            if left == 0 || input.line() > room {
                continue;
            }
            // What was chosen since it was counted may cover part of it. If it is still worth as much as the next was, it is the
            // best of all: no worth rises.
            if queue.peek().is_some_and(|(next, _)| left < *next) {
                queue.push((left, Reverse(at)));
                continue;
            }
            room -= input.line();
            so_far.extend(input.features.iter().map(|feature| counted(*feature)));
            chosen.push(input);
        }
    }
    chosen.sort_by(|one, other| by_length(one, other));
    chosen
}

fn covered<'a>(inputs: impl Iterator<Item = &'a Input>, counted: fn(u32) -> u32) -> HashSet<u32> {
    let features = inputs.flat_map(|input| &input.features);
    features.map(|feature| counted(*feature)).collect()
}

fn by_length(one: &Input, other: &Input) -> Ordering {
    let by_bytes = || one.bytes.cmp(&other.bytes);
    one.bytes.len().cmp(&other.bytes.len()).then_with(by_bytes)
}

fn edges<'a>(inputs: impl Iterator<Item = &'a Input>) -> usize {
    covered(inputs, edge).len()
}

/// libFuzzer counts an edge in eight steps, from once to 128 times and more.
fn edge(feature: u32) -> u32 {
    feature / 8
}

fn whole(feature: u32) -> u32 {
    feature
}

fn header(target: &str) -> String {
    format!(
        "# What fuzzing has found for `{target}` beyond its seeds: an input in each line, in hexadecimal, shortest first.\n\
         # Written by `cargo xtask fuzz --keep` (tools/xtask/src/corpora.rs).\n"
    )
}

/// The longest file of a target, in bytes: some 600 kB for all.
const MAX_BYTES: usize = 44_000;

#[cfg(test)]
mod what_is_kept {
    use super::*;

    fn input(bytes: &[u8], features: &[u32]) -> Input {
        Input {
            bytes: bytes.to_vec(),
            features: features.to_vec(),
        }
    }

    fn chosen(seeds: &[Input], found: &[Input], room: usize) -> Vec<Vec<u8>> {
        let chosen = choose(seeds, found, room).into_iter();
        chosen.map(|input| input.bytes.clone()).collect()
    }

    #[test]
    fn what_the_seeds_or_others_cover_is_left_out() {
        let seeds = [input(b"s", &[8, 16])];
        let found = [
            input(b"a", &[8]),
            input(b"bb", &[8, 24]),
            input(b"ccc", &[16, 24]),
            input(b"dddd", &[32]),
        ];
        let both = [b"bb".to_vec(), b"dddd".to_vec()];
        assert_eq!(chosen(&seeds, &found, 1_000), both);
    }

    #[test]
    fn what_covers_most_for_each_byte_comes_first() {
        let found = [
            input(b"a", &[8]),
            input(b"bbbb", &[8, 16, 24, 32]),
            input(b"cccccccc", &[16, 24, 32, 40]),
        ];
        // 9 bytes of text for four edges; "a" has nothing more then.
        assert_eq!(chosen(&[], &found, 9), [b"bbbb"]);
        let both = [b"bbbb".to_vec(), b"cccccccc".to_vec()];
        assert_eq!(chosen(&[], &found, 9 + 17), both);
        assert_eq!(chosen(&[], &found, 9 + 16), [b"bbbb"]);
        assert_eq!(chosen(&[], &found, 3), [b"a"]);
        assert!(chosen(&[], &found, 2).is_empty());
    }

    #[test]
    fn code_that_nothing_else_reaches_comes_before_how_often_it_is_passed() {
        let often: Vec<u32> = (0..8).collect();
        let found = [input(b"aa", &often), input(b"bbb", &[0, 8])];
        assert_eq!(chosen(&[], &found, 7), [b"bbb"]);
        let both = [b"aa".to_vec(), b"bbb".to_vec()];
        assert_eq!(chosen(&[], &found, 12), both);
    }

    #[test]
    fn the_control_file_of_a_merge_is_read() {
        let folder = std::env::temp_dir().join(format!("vsm-corpora-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder");
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.join(name);
            fs::write(&path, bytes).expect("a file");
            path.display().to_string()
        };
        let paths = [
            file("seed-00000", b"\x01"),
            file("kept-00003", b"\x02\xff"),
            file("4a", b"\x03\x04\x05\x06"),
            file("4b", b"\x02\xff"),
            file("4c", b""),
        ];
        let begin = format!("5\n2\n{}\n", paths.join("\n"));
        let features = "STARTED 0 1\nFT 0 8\nCOV 0 1\nFT 1 8 16\nCOV 1 2\nFT 2 24\nCOV 2\nFT 3 8 16\nFT 4 80\n";
        let kept = keep("ftp", &format!("{begin}{features}"), 3).expect("it is good");
        assert_eq!(kept.text, header("ftp") + "02ff\n030405\n");
        let summary =
            "ftp: 2 of 2 inputs; edges covered: 1 by the seeds, 3 with what is kept, 3 by all";
        assert_eq!(kept.summary, summary);

        let ended = keep(
            "ftp",
            &format!("{begin}{}", features.replace("FT 2 24\n", "")),
            3,
        );
        let refusal = ended.expect_err("an input has no features").to_string();
        assert!(refusal.contains("4a ends the target"), "{refusal}");
        assert!(keep("ftp", "", 3).is_err());
        fs::remove_dir_all(&folder).expect("it is there");
    }

    /// Of the repository.
    #[test]
    fn each_file_is_short_and_in_order() {
        let folder = crate::steps::root().join("tests/fuzz/corpora");
        for (target, longest) in crate::fuzz::TARGETS {
            let file = folder.join(format!("{target}.hex"));
            let text = fs::read_to_string(&file).expect(target);
            assert!(text.len() <= MAX_BYTES, "{target}: {} bytes", text.len());
            let lines = text.strip_prefix(&header(target)).expect(target);
            assert!(lines.ends_with('\n'), "{target}");
            let mut before: Option<&str> = None;
            for line in lines.lines() {
                let digits = line
                    .bytes()
                    .all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
                assert!(digits && line.len() % 2 == 0, "{target}: {line}");
                assert!(
                    (2..=2 * longest as usize).contains(&line.len()),
                    "{target}: {line}"
                );
                // Hexadecimal in lower case is in the order of its bytes.
                let key = |line: &str| (line.len(), line.to_owned());
                assert!(
                    before.is_none_or(|before| key(before) < key(line)),
                    "{target}: {line}"
                );
                before = Some(line);
            }
            assert!(before.is_some(), "{target}: nothing");
        }
    }
}
