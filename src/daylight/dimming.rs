//! Lamps that are dimmed to what daylight leaves missing, and what they take.

use crate::error::{Error, Result};

/// What [`Dimming::parse`] reads.
const FORM: &str = "write SETPOINT,POWER[,LEAST[,POWER THERE]][,off], such as 500lx,120W or 500lx,120W,10%,30W";

/// Rounds of [`settled_light`] after which zones are taken not to settle.
const MAX_ROUNDS: usize = 1000;

/// Share of full light by which zones may still move when they are settled.
const SETTLED: f64 = 1e-6;

/// How the lamps of a zone are dimmed by the sensor that sees them.
///
/// The control is a proportional one in a closed loop: lamps give the share of their full light that the sensor lacks, `(set point −
/// daylight) / lamps at full light`, and stay within their range. Power follows light in a straight line from the least to full light.
/// This is the continuous and, with `goes_off`, the continuous/off dimming control of EnergyPlus (*Engineering Reference*, Continuous Dimming
/// Control: `f_P = (f_L + (1 − f_L) f_P,min − f_L,min) / (1 − f_L,min)` of light and power as shares of the full ones), which takes lamps at
/// full light to give the set point; here they give what the matrix says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dimming {
    /// Illuminance that the sensor is to have, in lux.
    pub set_point: f64,
    /// Electric power at full light, in watts.
    pub full_watts: f64,
    /// Least share of the light, 0 to 1.
    pub least_light: f64,
    /// Electric power at the least light, in watts.
    pub least_watts: f64,
    /// Whether lamps are switched off where less than the least light would do; else they stay at it.
    pub goes_off: bool,
}

impl Dimming {
    /// Reads `SETPOINT,POWER[,LEAST[,POWER THERE]][,off]`, such as `500lx,120W,10%,30W`. Without a least light lamps go down to nothing; without
    /// a power there, it is that share of the full power.
    ///
    /// # Errors
    /// Text of another form; values that are out of range.
    pub fn parse(text: &str) -> Result<Self> {
        let refuse = |problem: &str| Err(Error::input(format!("'{text}'"), problem, FORM));
        let mut words: Vec<&str> = text.split(',').map(str::trim).collect();
        let goes_off = words.pop_if(|word| word.eq_ignore_ascii_case("off")).is_some();
        let number = |at: usize, units: &[&str]| number_with_unit(words.get(at)?, units);
        let (set_point, full_watts) = (number(0, &["lx", "lux"]), number(1, &["w"]));
        let (Some(set_point), Some(full_watts)) = (set_point, full_watts) else {
            return refuse("has no set point in lx and power in W");
        };
        let (least, least_watts) = (number(2, &["%"]), number(3, &["w"]));
        if words.len() > 4 || words.len() > 2 && least.is_none() || words.len() > 3 && least_watts.is_none() {
            return refuse(
                "says more than a set point and a power, but not the least light in % and the power there in W",
            );
        }
        let least_light = least.unwrap_or(0.0) / 100.0;
        let least_watts = least_watts.unwrap_or(least_light * full_watts);
        let dimming = Self { set_point, full_watts, least_light, least_watts, goes_off };
        dimming.check(&format!("'{text}'"))?;
        Ok(dimming)
    }

    /// Checks the values; `place` names them in the message.
    ///
    /// # Errors
    /// A set point or power that is not above 0; a least light that is not below all of it; a power there above the full one.
    pub fn check(&self, place: &str) -> Result<()> {
        let refuse = |problem: String, hint: &str| Err(Error::input(place, problem, hint));
        let is_above_zero = |value: f64| value > 0.0 && value.is_finite();
        if !is_above_zero(self.set_point) {
            return refuse(format!("{} lx is no set point", self.set_point), "give lx above 0");
        }
        if !is_above_zero(self.full_watts) {
            return refuse(format!("{} W is no power of lamps", self.full_watts), "give W above 0");
        }
        if !(0.0..1.0).contains(&self.least_light) {
            return refuse(format!("{} % is no least light", 100.0 * self.least_light), "give 0 % to less than 100 %");
        }
        if !(0.0..=self.full_watts).contains(&self.least_watts) {
            let problem = format!("{} W is no power at the least light", self.least_watts);
            return refuse(problem, "give 0 W to the power at full light");
        }
        Ok(())
    }

    /// The share of full light where a share is lacking.
    pub fn light(&self, lacking: f64) -> f64 {
        let lacking = lacking.clamp(0.0, 1.0);
        if self.goes_off && lacking < self.least_light.max(f64::MIN_POSITIVE) {
            0.0
        } else {
            lacking.max(self.least_light)
        }
    }

    /// Electric power at a share of full light, in watts.
    pub fn watts(&self, light: f64) -> f64 {
        if self.goes_off && light == 0.0 {
            return 0.0;
        }
        let above_least = (light - self.least_light) / (1.0 - self.least_light);
        self.least_watts + (self.full_watts - self.least_watts) * above_least.max(0.0)
    }
}

/// Reads a number with one of these units behind it, which are written in small letters, such as `500lx` or `500 Lux`.
pub fn number_with_unit(text: &str, units: &[&str]) -> Option<f64> {
    let text = text.to_ascii_lowercase();
    units.iter().find_map(|unit| text.strip_suffix(unit))?.trim_end().parse().ok()
}

/// The shares of full light at which zones settle whose sensors see the lamps of all: `daylight` has the lux at each sensor, `full` for
/// each sensor the lux by the lamps of each zone at full light. Also whether they settle at all.
///
/// One zone after the other is set to what its sensor lacks, until none moves (the projected Gauss–Seidel method; Cottle, Pang and Stone,
/// *The Linear Complementarity Problem*, §5.2).
///
/// # Panics
/// If the numbers of zones, sensors and lamps differ.
pub fn settled_light(zones: &[Dimming], daylight: &[f64], full: &[&[f64]]) -> (Vec<f64>, bool) {
    assert!(daylight.len() == zones.len() && full.len() == zones.len(), "a sensor for each zone");
    let mut light = vec![0.0; zones.len()];
    for _ in 0..MAX_ROUNDS {
        let mut moved = 0.0f64;
        for (at, zone) in zones.iter().enumerate() {
            let by_all: f64 = full[at].iter().zip(&light).map(|(full, light)| full * light).sum();
            let by_others = by_all - full[at][at] * light[at];
            let next = zone.light((zone.set_point - daylight[at] - by_others) / full[at][at]);
            moved = moved.max((next - light[at]).abs());
            light[at] = next;
        }
        if moved <= SETTLED {
            return (light, true);
        }
    }
    (light, false)
}

/// What the lamps of a zone do in the time of use of a year.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LampYear {
    /// Electric energy in kWh.
    pub kilowatt_hours: f64,
    /// The same of lamps at full light in all hours of use.
    pub undimmed_kilowatt_hours: f64,
    /// Hours of use.
    pub hours: f64,
    /// Hours at full light.
    pub full_hours: f64,
    /// Hours at the least light, where that is not off.
    pub least_hours: f64,
    /// Hours off.
    pub off_hours: f64,
    /// Hours in which the set point is missed by more than a hundredth of it.
    pub short_hours: f64,
}

impl LampYear {
    /// Adds `hours` at a share of full light, with so many lux at the sensor.
    pub fn add(&mut self, dimming: &Dimming, light: f64, lux: f64, hours: f64) {
        let counted = |is_so: bool| if is_so { hours } else { 0.0 };
        self.kilowatt_hours += dimming.watts(light) * hours / 1000.0;
        self.undimmed_kilowatt_hours += dimming.full_watts * hours / 1000.0;
        self.hours += hours;
        self.full_hours += counted(light >= 1.0 - SETTLED);
        self.off_hours += counted(light <= SETTLED);
        self.least_hours += counted(light > SETTLED && light <= dimming.least_light + SETTLED);
        self.short_hours += counted(lux < 0.99 * dimming.set_point);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dimming(text: &str) -> Dimming {
        Dimming::parse(text).unwrap()
    }

    #[test]
    fn what_is_written_is_read_and_what_is_none_is_told() {
        let plain =
            Dimming { set_point: 500.0, full_watts: 120.0, least_light: 0.0, least_watts: 0.0, goes_off: false };
        assert_eq!(dimming("500lx,120W"), plain);
        assert_eq!(dimming(" 500 lux , 120 w "), plain);
        assert_eq!(dimming("500lx,120W,off"), Dimming { goes_off: true, ..plain });
        assert_eq!(dimming("500lx,120W,10%"), Dimming { least_light: 0.1, least_watts: 12.0, ..plain });
        let whole = Dimming { least_light: 0.1, least_watts: 30.0, goes_off: true, ..plain };
        assert_eq!(dimming("500lx,120W,10%,30W,off"), whole);
        for (bad, wanted) in [
            ("", "no set point in lx and power"),
            ("500,120", "no set point in lx and power"),
            ("500lx", "no set point in lx and power"),
            ("500lx,120W,10", "says more than"),
            ("500lx,120W,10%,30", "says more than"),
            ("500lx,120W,10%,30W,1", "says more than"),
            ("0lx,120W", "0 lx is no set point"),
            ("nanlx,120W", "NaN lx is no set point"),
            ("500lx,-1W", "-1 W is no power"),
            ("500lx,120W,100%", "100 % is no least light"),
            ("500lx,120W,10%,130W", "130 W is no power at the least light"),
        ] {
            let problem = Dimming::parse(bad).unwrap_err().to_string();
            assert!(problem.contains(wanted), "{bad}: {problem}");
        }
    }

    /// The equation of EnergyPlus's *Engineering Reference*, with the f_L,min = 0.2 and f_P,min = 0.3 of its object `Daylighting:Controls`.
    #[test]
    fn power_is_that_of_energyplus() {
        let zone = dimming("500lx,100W,20%,30W");
        for step in 0..=100 {
            let lacking = f64::from(step) / 100.0;
            let (least_light, least_power) = (0.2, 0.3);
            let wanted = if lacking < least_light {
                least_power
            } else {
                (lacking + (1.0 - lacking) * least_power - least_light) / (1.0 - least_light)
            };
            let found = zone.watts(zone.light(lacking)) / 100.0;
            assert!((found - wanted).abs() < 1e-12, "{lacking}: {found} for {wanted}");
            let off = Dimming { goes_off: true, ..zone };
            let wanted = if lacking < least_light { 0.0 } else { wanted };
            assert!((off.watts(off.light(lacking)) / 100.0 - wanted).abs() < 1e-12);
        }
        assert_eq!([-1.0, 0.1, 2.0].map(|lacking| zone.light(lacking)), [0.2, 0.2, 1.0]);
    }

    /// Two zones that see each other, by the solution of their two equations: 600 a + 100 b = 500 − d, 100 a + 600 b = 500 − e.
    #[test]
    fn zones_settle_where_their_equations_are_solved() {
        let zones = [dimming("500lx,1W"); 2];
        let full: [&[f64]; 2] = [&[600.0, 100.0], &[100.0, 600.0]];
        for (d, e) in [(0.0, 0.0), (100.0, 200.0), (300.0, 0.0)] {
            let (light, is_settled) = settled_light(&zones, &[d, e], &full);
            let wanted = [600.0 * (500.0 - d) - 100.0 * (500.0 - e), 600.0 * (500.0 - e) - 100.0 * (500.0 - d)];
            for (found, wanted) in light.iter().zip(wanted.map(|value| value / (600.0 * 600.0 - 100.0 * 100.0))) {
                assert!(is_settled && (found - wanted).abs() < 1e-5, "{d} {e}: {found} for {wanted}");
            }
        }
        // Where the first has enough, the second sees its own light alone; where lamps do not suffice, they are at full light.
        assert_eq!(settled_light(&zones, &[900.0, 200.0], &full).0, [0.0, 0.5]);
        assert_eq!(settled_light(&zones, &[0.0, 0.0], &[&[200.0, 0.0], &[0.0, 300.0]]).0, [1.0, 1.0]);
    }

    /// By hand: 2 h at full light, 1 h at half, 4 h at none, of 100 W.
    #[test]
    fn energy_and_hours_are_those_counted_by_hand() {
        let zone = dimming("500lx,100W");
        let mut year = LampYear::default();
        year.add(&zone, 1.0, 400.0, 2.0);
        year.add(&zone, 0.5, 500.0, 1.0);
        year.add(&zone, 0.0, 800.0, 4.0);
        let wanted = LampYear {
            kilowatt_hours: 0.25,
            undimmed_kilowatt_hours: 0.7,
            hours: 7.0,
            full_hours: 2.0,
            least_hours: 0.0,
            off_hours: 4.0,
            short_hours: 2.0,
        };
        assert!((year.kilowatt_hours - 0.25).abs() < 1e-12 && (year.undimmed_kilowatt_hours - 0.7).abs() < 1e-12);
        assert_eq!(LampYear { kilowatt_hours: 0.25, undimmed_kilowatt_hours: 0.7, ..year }, wanted);
        let mut least = LampYear::default();
        let zone = dimming("500lx,100W,10%,30W");
        least.add(&zone, zone.light(0.0), 900.0, 10.0);
        assert_eq!((least.least_hours, least.off_hours), (10.0, 0.0));
        assert!((least.kilowatt_hours - 0.3).abs() < 1e-12);
    }
}
