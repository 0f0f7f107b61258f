//! Cards in the terminal: printed when they are shown, answered by a line.

use std::io::{BufRead as _, Write as _};
use std::sync::Arc;

use super::board::{Board, Card, Reply};

/// Reads replies from standard input until it ends.
pub fn listen(board: &Arc<Board>) {
    let board = board.clone();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            let Some(reply) = parse(&line) else {
                print("expected y (yes, done), n (no) or s (skip)");
                continue;
            };
            if let Err(error) = board.reply(board.card().number, reply, "") {
                print(&error.to_string());
            }
        }
    });
}

fn parse(line: &str) -> Option<Reply> {
    match line.trim().to_lowercase().as_str() {
        "y" | "yes" | "done" => Some(Reply::Yes),
        "n" | "no" => Some(Reply::No),
        "s" | "skip" => Some(Reply::Skip),
        _ => None,
    }
}

pub(super) fn print_card(card: &Card) {
    let hint = match &card.question {
        Some(question) => format!("   {question} [y/n/s]"),
        None => {
            "   [the wire shows when it is done; s skips, y goes on where nothing is sent]".into()
        }
    };
    print(&format!(
        "\n{} of {} ({})  {}\n{hint}",
        card.number, card.of, card.scenario, card.card
    ));
}

fn print(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_reply_or_nothing() {
        assert_eq!(parse(" Y\n"), Some(Reply::Yes));
        assert_eq!(parse("no"), Some(Reply::No));
        assert_eq!(parse("skip"), Some(Reply::Skip));
        assert_eq!(parse("perhaps"), None);
    }
}
