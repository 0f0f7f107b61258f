//! One setting of PX4: how a value is shown, and which values weaken what.

/// The judgement of a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It weakens the link, or what the vehicle does without it.
    Weak,
    /// Right for one vehicle and wrong for another: the operator has to decide.
    Decide,
    /// Nothing to change.
    Good,
    /// Not read, or the vehicle does not have it.
    Unknown,
}

/// One parameter: which of its values weaken what.
#[derive(Debug)]
pub struct Setting {
    /// PX4's name.
    pub name: &'static str,
    /// What its value means.
    pub meaning: Meaning,
    /// Rules in order: the first one that applies counts. A value to which none applies is good.
    pub(super) rules: &'static [Rule],
    /// What to set instead.
    pub better: f64,
    /// The parameter that enables it: while that is 0, this setting has no effect.
    pub(super) needs: Option<&'static str>,
    /// Where PX4 v1.18's source uses it.
    pub source: &'static str,
}

/// How a value is shown.
#[derive(Debug, Clone, Copy)]
pub enum Meaning {
    /// One of these, and no other: PX4 stores other values too, and most of them switch the action off.
    Choice(&'static [(i32, &'static str)]),
    /// One of these, or another that depends on the board.
    Open(&'static [(i32, &'static str)]),
    /// A set of bits, named from the lowest.
    Bits(&'static [&'static str]),
    /// A number of this unit.
    Number(&'static str),
}

/// The judgement of some values, and the reason.
#[derive(Debug)]
pub(super) struct Rule {
    pub(super) when: When,
    pub(super) verdict: Verdict,
    pub(super) why: &'static str,
}

/// The values to which a rule applies.
#[derive(Debug)]
pub(super) enum When {
    Is(&'static [i32]),
    Not(i32),
    Above(f64),
}

impl Setting {
    pub(super) fn judge(&self, value: f64) -> (Verdict, &'static str) {
        if !value.is_finite() || !self.meaning.has(value) {
            return (
                Verdict::Weak,
                "PX4 v1.18 does not know this value; of most settings it then does nothing",
            );
        }
        let fits = |rule: &&Rule| match rule.when {
            When::Is(values) => values.iter().any(|one| f64::from(*one) == value),
            When::Not(one) => f64::from(one) != value,
            When::Above(most) => value > most,
        };
        let rule = self.rules.iter().find(fits);
        rule.map_or((Verdict::Good, ""), |rule| (rule.verdict, rule.why))
    }
}

impl Meaning {
    fn has(self, value: f64) -> bool {
        match self {
            Meaning::Choice(values) => values.iter().any(|(one, _)| f64::from(*one) == value),
            Meaning::Open(_) | Meaning::Number(_) => true,
            // PX4 ignores bits that it has no name for; a fraction or a negative number is not a set of bits.
            Meaning::Bits(_) => value >= 0.0 && value.fract() == 0.0,
        }
    }

    /// `2 (return)`, `3 (mission, auto modes)`, `10 s`.
    pub(super) fn show(self, value: f64) -> String {
        let name = match self {
            Meaning::Choice(values) | Meaning::Open(values) => values
                .iter()
                .find(|(one, _)| f64::from(*one) == value)
                .map(|(_, name)| (*name).to_owned()),
            Meaning::Bits(names) => {
                let bits = value as u64;
                let set = (0..).zip(names).filter(|(bit, _)| bits & (1 << bit) != 0);
                let set: Vec<&str> = set.map(|(_, name)| *name).collect();
                Some(if set.is_empty() {
                    "none".to_owned()
                } else {
                    set.join(", ")
                })
            }
            Meaning::Number(unit) => return format!("{value} {unit}"),
        };
        name.map_or_else(|| value.to_string(), |name| format!("{value} ({name})"))
    }
}
