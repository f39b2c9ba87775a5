//! Runs loops with the widest vectors of the processor.
//!
//! Programs are compiled for any 64-bit processor, whose vectors hold four single-precision numbers; nearly every one of the last ten years
//! also has vectors of eight. A loop within [`widest`] is compiled for both, and the version for the processor at hand is chosen at run time. Both
//! give the same bits: sums use a number of lanes that does not depend on the processor, and products and sums are never fused.

/// Runs `work` compiled for vectors of eight numbers if the processor has them. `work` and everything it calls must be `#[inline(always)]`;
/// otherwise it is compiled for four like all other code.
#[inline]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has been checked for the required feature.
        #[allow(unsafe_code)]
        return unsafe { with_avx2(work) };
    }
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(always)]
    fn sum(numbers: &[f32]) -> f32 {
        let mut lanes = [0.0_f32; 8];
        for part in numbers.as_chunks::<8>().0 {
            for k in 0..8 {
                lanes[k] += part[k] * part[7 - k] + 0.1;
            }
        }
        lanes.iter().sum::<f32>()
    }

    #[test]
    fn both_versions_give_the_same_bits() {
        let numbers: Vec<f32> = (0..1000).map(|k| 1.0 / (k as f32 + 0.3)).collect();
        let wide = widest(
            #[inline(always)]
            || sum(&numbers),
        );
        assert_eq!(wide.to_bits(), sum(&numbers).to_bits());
    }
}
