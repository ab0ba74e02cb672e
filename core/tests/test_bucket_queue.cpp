// The circular bucket queue beside an ordered multimap.
#include <map>

#include <doctest/doctest.h>

#include "planning/bucket_queue.hpp"
#include "random.hpp"

namespace adrl {

TEST_CASE("entries come out by key, whatever order they went in, and across many turns of the circle") {
    BucketQueue queue(64, 16);
    for (std::uint32_t round = 0; round < 3; ++round) {
        std::multimap<std::uint32_t, std::uint32_t> twin;
        std::uint32_t least = 7 * round;
        queue.clear(least);
        const auto push = [&](std::uint32_t k) {
            const auto above = static_cast<std::uint32_t>(63.0 * uniform01(mix64(random_key(round, k))));
            queue.push({least + above, k, k});
            twin.insert({least + above, k});
        };
        QueuedNode at{};
        bool same = true;
        for (std::uint32_t k = 0; k < 2000; ++k) {
            push(2 * k);
            if (k % 100 == 0) push(2 * k + 1);
            if (twin.size() < 8) continue;
            same = same && queue.pop(at) && at.key == twin.begin()->first && at.cost == at.node;
            least = at.key;
            const auto [first, last] = twin.equal_range(at.key);
            auto found = first;
            while (found != last && found->second != at.node) ++found;
            same = same && found != last;
            if (found != last) twin.erase(found);
        }
        CHECK(same);
        CHECK(least > 640); // ten turns at least
        CHECK_FALSE(twin.empty());
    } // what is left over is forgotten by clear()
    queue.clear(5);
    QueuedNode at{};
    CHECK_FALSE(queue.pop(at));
    queue.push({9, 1, 1});
    queue.push({9, 2, 2});
    CHECK(queue.pop(at));
    CHECK(at.node == 2); // of one key the newest first
    CHECK(queue.pop(at));
    CHECK(at.node == 1);
    CHECK_FALSE(queue.pop(at));
}

} // namespace adrl
