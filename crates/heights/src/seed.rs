//! One root seed, and random streams keyed by what they are for, never by thread.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The stream for one purpose of one run: the same `root` and `keys` give the same numbers on any machine and any
/// number of threads. By convention `keys` is (stage name, then indices such as epoch and view).
///
/// ```
/// use rand::Rng;
/// let mut a = sizeup_heights::seed::stream(7, "pairs", &[3, 12]);
/// let mut b = sizeup_heights::seed::stream(7, "pairs", &[3, 12]);
/// assert_eq!(a.random::<u64>(), b.random::<u64>());
/// ```
#[must_use]
pub fn stream(root: u64, stage: &str, keys: &[u64]) -> ChaCha8Rng {
    // FNV-1a over everything that names the stream, then splitmix64 to spread it over the 256-bit key.
    let mut state = 0xcbf2_9ce4_8422_2325_u64;
    let mut absorb = |byte: u8| state = (state ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    root.to_le_bytes().into_iter().for_each(&mut absorb);
    stage.bytes().for_each(&mut absorb);
    for key in keys {
        absorb(0xff);
        key.to_le_bytes().into_iter().for_each(&mut absorb);
    }
    let mut key = [0_u8; 32];
    for chunk in key.chunks_exact_mut(8) {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        chunk.copy_from_slice(&(z ^ (z >> 31)).to_le_bytes());
    }
    ChaCha8Rng::from_seed(key)
}

/// A number for a name (FNV-1a), to key a stream by what a thing is called rather than by where it stands in a list.
#[must_use]
pub fn key_of(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |state, byte| (state ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    #[test]
    fn every_part_of_the_key_changes_the_stream() {
        let mut first: Vec<u64> = [
            stream(1, "a", &[]),
            stream(2, "a", &[]),
            stream(1, "b", &[]),
            stream(1, "a", &[0]),
            stream(1, "a", &[0, 0]),
            stream(1, "a", &[1]),
        ]
        .iter_mut()
        .map(Rng::random)
        .collect();
        first.sort_unstable();
        first.dedup();
        assert_eq!(first.len(), 6);
    }
}
