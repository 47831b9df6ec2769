//! Days of a year.

/// Days of a year without a leap day before each month, and in all.
pub const DAYS_BEFORE_MONTH: [u16; 13] = [0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365];

/// Whether there is such a day; 29 February counts as one.
pub(super) fn is_day(month: u8, day: u8) -> bool {
    (1..=12).contains(&month) && day >= 1 && u16::from(day) <= days_of(month)
}

fn days_of(month: u8) -> u16 {
    let month = usize::from(month);
    DAYS_BEFORE_MONTH[month] - DAYS_BEFORE_MONTH[month - 1] + u16::from(month == 2)
}

/// Number of a day in its year, 1 for the first of January; `after_leap_day` says whether a 29 February came before it.
pub(super) fn day_of_year(month: u8, day: u8, after_leap_day: bool) -> u16 {
    DAYS_BEFORE_MONTH[usize::from(month) - 1] + u16::from(day) + u16::from(after_leap_day)
}

/// The day after another, without a leap day unless there is one.
pub(super) fn next_day((month, day): (u8, u8), has_leap_day: bool) -> (u8, u8) {
    let last = days_of(month) - u16::from(month == 2 && !has_leap_day);
    match u16::from(day) < last {
        true => (month, day + 1),
        false => (month % 12 + 1, 1),
    }
}
