//! Which of several views have their factors in memory.

/// The budget of each view, in bytes, in the order in which they are given, most recently seen first; none for those that memory has no
/// room for. The first gets what it `needed`, or all there is; of the others those that fit beside it whole, in their order.
pub fn budgets(needed: &[u64], memory_bytes: u64) -> Vec<Option<u64>> {
    let mut left = memory_bytes;
    let share = |(order, &needed): (usize, &u64)| {
        let own = if order == 0 { Some(needed.min(left)) } else { Some(needed).filter(|&needed| needed <= left) };
        left -= own.unwrap_or(0);
        own
    };
    needed.iter().enumerate().map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_views_stay_as_far_as_memory_goes() {
        assert_eq!(budgets(&[4, 5, 3, 1], 10), [Some(4), Some(5), None, Some(1)]);
        assert_eq!(budgets(&[40, 5, 0], 10), [Some(10), None, Some(0)], "one that is larger than memory has it alone");
        assert_eq!(budgets(&[], 10), []);
        for memory in 0..20 {
            let held: u64 = budgets(&[3, 9, 2, 7], memory).into_iter().flatten().sum();
            assert!(held <= memory);
        }
    }
}
