//! The geofence, as far as PX4 checks a plan against it.

use mavlink_link::service::mission::Item;

use super::geo::{Geodetic, LocalFrame, Ned};

#[derive(Debug, Clone)]
enum Area {
    Circle { centre: Ned, radius: f64 },
    Polygon(Vec<Ned>),
}

/// The areas of a fence plan.
#[derive(Debug, Clone, Default)]
pub(super) struct Fence {
    keep_in: Vec<Area>,
    keep_out: Vec<Area>,
}

impl Fence {
    /// From the stored items; what does not make an area is left out.
    pub(super) fn new(items: &[Item], frame: &LocalFrame) -> Self {
        let mut fence = Self::default();
        let place = |item: &Item| {
            frame.to_local(Geodetic {
                latitude_deg: f64::from(item.x) * 1e-7,
                longitude_deg: f64::from(item.y) * 1e-7,
                altitude_m: 0.0,
            })
        };
        let mut i = 0;
        while let Some(item) = items.get(i) {
            let side = match item.command {
                5001 | 5003 => &mut fence.keep_in,
                5002 | 5004 => &mut fence.keep_out,
                _ => {
                    i += 1;
                    continue;
                }
            };
            if matches!(item.command, 5003 | 5004) {
                side.push(Area::Circle {
                    centre: place(item),
                    radius: f64::from(item.params[0]),
                });
                i += 1;
            } else {
                let corners = (item.params[0] as usize).clamp(1, items.len() - i);
                side.push(Area::Polygon(
                    items[i..i + corners].iter().map(place).collect(),
                ));
                i += corners;
            }
        }
        fence
    }

    /// Inside every area to stay in together, outside every area to stay out of.
    pub(super) fn allows(&self, at: Ned) -> bool {
        (self.keep_in.is_empty() || self.keep_in.iter().any(|a| a.contains(at)))
            && !self.keep_out.iter().any(|a| a.contains(at))
    }
}

impl Area {
    fn contains(&self, at: Ned) -> bool {
        match self {
            Self::Circle { centre, radius } => (at - *centre).horizontal() <= *radius,
            Self::Polygon(corners) => {
                let mut inside = false;
                let mut from = match corners.last() {
                    Some(last) => *last,
                    None => return false,
                };
                for &to in corners {
                    if (to.e > at.e) != (from.e > at.e)
                        && at.n < (from.n - to.n) * (at.e - to.e) / (from.e - to.e) + to.n
                    {
                        inside = !inside;
                    }
                    from = to;
                }
                inside
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_keeps_in_and_a_circle_keeps_out() {
        let frame = LocalFrame::new(Geodetic {
            latitude_deg: 47.0,
            longitude_deg: 8.0,
            altitude_m: 0.0,
        });
        let item = |command, param1, n, e| {
            let at = frame.to_global(Ned::new(n, e, 0.0));
            Item {
                command,
                params: [param1, 0.0, 0.0, 0.0],
                x: (at.latitude_deg * 1e7) as i32,
                y: (at.longitude_deg * 1e7) as i32,
                ..Item::default()
            }
        };
        let fence = Fence::new(
            &[
                item(5001, 4.0, 100.0, 100.0),
                item(5001, 4.0, 100.0, -100.0),
                item(5001, 4.0, -100.0, -100.0),
                item(5001, 4.0, -100.0, 100.0),
                item(5004, 20.0, 50.0, 50.0),
            ],
            &frame,
        );
        assert!(fence.allows(Ned::new(-50.0, 10.0, 0.0)));
        assert!(!fence.allows(Ned::new(-150.0, 10.0, 0.0)));
        assert!(!fence.allows(Ned::new(55.0, 45.0, 0.0)));
    }
}
