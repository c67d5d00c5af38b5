//! Tests of several threads: the same bits, and only where a slice is worth it.

use simd::sharing::Sharing;
use simd::team::Team;

use super::*;

#[test]
fn simd_and_threads_give_same_bits() {
    let scan = scan(Scene::Blobs(phantom::scene::Blobs::draw(1)), 8, 6.0, Depth::U8);
    let ways = [
        (Method::Gaussian, Compounding::Mean),
        (Method::BSpline3, Compounding::Mean),
        (Method::Linear, Compounding::Mean),
        (Method::Nearest, Compounding::Mean),
        (Method::Gaussian, Compounding::Maximum),
        (Method::Linear, Compounding::Latest),
    ];
    for (method, compounding) in ways {
        let run = |simd, threads| {
            let settings = Settings { method, compounding, simd, threads, max_weight: 1.5, ..settings() };
            let mut r = Reconstructor::new(settings, fan()).unwrap();
            let touched: Vec<_> = (0..scan.frames()).map(|i| r.insert(&scan.slice(i)).unwrap()).collect();
            (touched, bits(r.volume()), r.work())
        };
        let reference = run(Simd::Portable, 1);
        let clamps = compounding == Compounding::Mean;
        assert_eq!(reference.2.weights_clamped > 0, clamps, "the clamp is part of what must agree");
        for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
            for threads in [1, 2, 7] {
                let same = run(simd, threads) == reference;
                assert!(same, "{method:?}, {compounding:?}: {} with {threads} threads", simd.name());
            }
        }
    }
}

#[test]
fn threads_are_woken_by_work_of_slices_like_last() {
    let team = Team::new("test", 2).unwrap();
    let wakes = |spacing: f64| {
        let scan = scan(Scene::Constant(50.0), 2, 0.0, Depth::U8);
        let mut r = Reconstructor::new(Settings::new(DVec3::splat(spacing)), Mask::full(72, 60)).unwrap();
        let sharing = |r: &Reconstructor| matches!(r.sharing(team.as_ref()), Sharing::Team { wakes: true, .. });
        let before = sharing(&r);
        r.insert(&scan.slice(0)).unwrap();
        [before, sharing(&r)]
    };
    // 18 × 15 mm of image, some 5 mm thick: 11,000 voxels of 0.5 mm, and 170,000 of 0.2 mm.
    assert_eq!(wakes(0.5), [false, false]);
    assert_eq!(wakes(0.2), [false, true]);
    assert!(matches!(Reconstructor::new(settings(), fan()).unwrap().sharing(None), Sharing::Alone));
}
