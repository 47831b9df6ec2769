//! Errors and times as people write them.

/// Reads an error such as `2%` or `0.02`.
///
/// # Errors
/// As text: not a number.
pub fn parse_error(text: &str) -> Result<f64, String> {
    let (number, scale) = text.strip_suffix('%').map_or((text, 1.0), |number| (number, 0.01));
    let value: f64 = number.trim().parse().map_err(|_| format!("'{text}' is not an error; write 2% or 0.02"))?;
    Ok(value * scale)
}

/// Reads a time such as `60s`, `5min`, `2h` or plain seconds.
///
/// # Errors
/// As text: not a time.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    let split = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let scale = match unit.trim() {
        "" | "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(format!("'{unit}' is not a unit of time; write s, min or h")),
    };
    let value: f64 = number.parse().map_err(|_| format!("'{text}' is not a time; write 60s or 5min"))?;
    Ok(value * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_times_are_read_with_their_units() {
        assert_eq!((parse_error("2%"), parse_error("0.02")), (Ok(0.02), Ok(0.02)));
        assert_eq!((parse_seconds("60s"), parse_seconds("1.5min"), parse_seconds("7")), (Ok(60.0), Ok(90.0), Ok(7.0)));
        assert!(parse_error("two").is_err() && parse_seconds("5 days").is_err() && parse_seconds("s").is_err());
    }
}
