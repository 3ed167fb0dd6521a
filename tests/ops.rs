//! Instruction counts: the counters on functions whose counts are known.

#[cfg(all(rayo_asm, target_os = "linux"))]
mod executed {
    use rayo::kernels::KNOWN;
    use rayo::kernels::step::{count_function, count_instructions};

    #[test]
    fn single_stepping_counts_known_functions_exactly() {
        for known in KNOWN {
            let visits = count_function(known.address(), 1 << 14, || {
                known.call();
                known.call();
            })
            .unwrap();
            let once = known.executed + 2; // endbr64, ret
            assert_eq!(visits.calls, 2, "{}", known.symbol);
            assert_eq!(visits.at.iter().sum::<u64>(), 2 * once, "{}", known.symbol);
            assert_eq!(visits.instructions, 2 * (once + known.elsewhere), "{}", known.symbol);
        }
    }

    #[test]
    fn a_loop_is_counted_by_its_trips_at_each_of_its_instructions() {
        let known = KNOWN.iter().find(|known| known.symbol == "rayo_known_loop").unwrap();
        let visits = count_function(known.address(), 64, || known.call()).unwrap();
        let executed: Vec<_> = visits.at.into_iter().filter(|&times| times > 0).collect();
        assert_eq!(executed, [1, 1, 10, 10, 1]); // endbr64, mov, dec, jnz, ret
    }

    #[test]
    fn a_closure_is_counted_with_what_it_calls() {
        let [short, long] = ["rayo_known_7", "rayo_known_1000"]
            .map(|symbol| KNOWN.iter().find(|known| known.symbol == symbol).unwrap())
            .map(|known| count_instructions(|| std::hint::black_box(known).call()).unwrap());
        assert_eq!(long - short, 993);
    }

    #[test]
    fn a_function_that_is_not_called_has_no_visits() {
        let visits = count_function(KNOWN[0].address(), 64, || KNOWN[1].call()).unwrap();
        assert_eq!((visits.calls, visits.instructions), (0, 0));
    }

    #[test]
    fn threads_that_count_at_the_same_time_do_not_disturb_each_other() {
        let known = KNOWN.iter().find(|known| known.symbol == "rayo_known_1000").unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..20 {
                        assert_eq!(count_function(known.address(), 0, || known.call()).unwrap().instructions, 1002);
                    }
                });
            }
        });
    }

    #[test]
    fn a_panic_in_what_is_counted_comes_out_and_counting_goes_on() {
        let panic = std::panic::catch_unwind(|| count_instructions(|| panic!("on purpose"))).unwrap_err();
        assert_eq!(panic.downcast_ref::<&str>(), Some(&"on purpose"));
        assert!(count_instructions(|| ()).unwrap() > 0);
    }
}
