// The thread pool covers every index exactly once, however many threads and however often.
#include <atomic>
#include <numeric>
#include <vector>

#include <doctest/doctest.h>

#include "thread_pool.hpp"

namespace adrl {

TEST_CASE("every index is visited exactly once") {
    for (const int threads : {1, 2, 3, 7, 16}) {
        ThreadPool pool(threads);
        CHECK(pool.size() == threads);
        for (const int count : {0, 1, 2, 3, 7, 8, 64, 1000}) {
            CAPTURE(threads);
            CAPTURE(count);
            std::vector<std::atomic<int>> visits(count);
            pool.run(count, [&](int first, int last) {
                for (int i = first; i < last; ++i) visits[i].fetch_add(1);
            });
            bool once = true;
            for (const std::atomic<int> &v : visits) once = once && v.load() == 1;
            CHECK(once);
        }
    }
}

TEST_CASE("ranges are in order and not empty") {
    ThreadPool pool(3);
    std::atomic<bool> good{true};
    pool.run(100, [&](int first, int last) {
        if (first < 0 || first >= last || last > 100) good = false;
    });
    CHECK(good.load());
}

TEST_CASE("run returns after all work is done, thousands of times in a row") {
    ThreadPool pool(4);
    std::vector<long> sums(50, 0); // plain numbers: a run that returned too early would be seen, or race
    for (int round = 1; round <= 5000; ++round) {
        pool.run(static_cast<int>(sums.size()), [&](int first, int last) {
            for (int i = first; i < last; ++i) sums[i] += i;
        });
        REQUIRE(std::accumulate(sums.begin(), sums.end(), 0L) == static_cast<long>(round) * (49 * 50 / 2));
    }
}

TEST_CASE("a pool that has never worked ends") {
    for (int i = 0; i < 50; ++i) {
        const ThreadPool pool(3);
        CHECK(pool.size() == 3);
    }
}

TEST_CASE("no number of threads means one a core") { CHECK(ThreadPool(0).size() >= 1); }

} // namespace adrl
