//! The picture of the goals: each figure as a part of its goal, its spread, and the line that it should not cross.

/// Draws bars from what is given: what, and median, least and greatest as parts of the goal.
pub(super) fn draw(shares: &[(&'static str, [f64; 3])]) -> String {
    let height = TOP + ROW * shares.len() as f64 + 40.0;
    let goal = x(1.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
         font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" font-size=\"12\" fill=\"#222\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
         <text x=\"16\" y=\"24\" font-size=\"16\" font-weight=\"bold\">Each figure as a part of its goal</text>\n\
         <text x=\"{goal}\" y=\"44\" text-anchor=\"middle\">the goal</text>\n"
    );
    for (number, (what, [median, min, max])) in shares.iter().enumerate() {
        let y = TOP + ROW * number as f64;
        let middle = y + BAR / 2.0;
        let colour = if *median <= 1.0 { MET } else { MISSED };
        let (left, width) = (x(0.0), x(*median) - x(0.0));
        let (from, to) = (x(*min), x(*max));
        // Beyond the scale the number alone says how far.
        let percent = format!("{:.0} %", median * 100.0);
        let beside = to.max(x(*median)) + 8.0;
        out += &format!(
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{what}</text>\n\
             <rect x=\"{left}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{BAR}\" fill=\"{colour}\"/>\n\
             <path d=\"M{from:.1} {middle}H{to:.1}\" stroke=\"#222\"/>\n\
             <text x=\"{beside:.1}\" y=\"{}\">{percent}</text>\n",
            left - 8.0,
            middle + 4.0,
            middle + 4.0,
        );
    }
    let bottom = TOP + ROW * shares.len() as f64;
    out += &format!(
        "<path d=\"M{goal} 50V{bottom}\" stroke=\"#222\" stroke-dasharray=\"4 3\"/>\n\
         <text x=\"16\" y=\"{}\">bar: median; line: least to greatest of the turns</text>\n</svg>\n",
        bottom + 24.0
    );
    out
}

/// Where a part of the goal is, as far as the scale reaches.
fn x(share: f64) -> f64 {
    LEFT + SCALE * share.clamp(0.0, LONGEST)
}

const WIDTH: f64 = 1_000.0;
/// Right of the names.
const LEFT: f64 = 420.0;
const TOP: f64 = 60.0;
const ROW: f64 = 26.0;
const BAR: f64 = 16.0;
/// Of the goal itself.
const SCALE: f64 = 250.0;
/// So many goals are drawn at most.
const LONGEST: f64 = 2.0;
const MET: &str = "#21918c";
const MISSED: &str = "#c3243c";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_end_at_their_part_of_the_goal_and_within_the_picture() {
        let picture = draw(&[
            ("half", [0.5, 0.4, 0.6]),
            ("far beyond", [30.0, 20.0, 40.0]),
        ]);
        assert!(
            picture.contains("width=\"125.0\" height=\"16\" fill=\"#21918c\""),
            "{picture}"
        );
        assert!(
            picture.contains("width=\"500.0\" height=\"16\" fill=\"#c3243c\""),
            "{picture}"
        );
        assert!(picture.contains("M520.0 68H570.0"), "{picture}");
        assert!(picture.contains(">3000 %<"), "{picture}");
    }
}
