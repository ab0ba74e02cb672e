// A step, a plan and a reset allocate nothing once the simulator stands: the global operator new counts.
#include <atomic>
#include <cstdlib>
#include <new>

#include <doctest/doctest.h>

#include "sim_fixture.hpp"

namespace {

std::atomic<long> allocations{0};

void *counted(std::size_t size, std::size_t alignment) {
    allocations.fetch_add(1);
    void *p = std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
    if (p == nullptr) throw std::bad_alloc();
    return p;
}

} // namespace

void *operator new(std::size_t size) { return counted(size == 0 ? 1 : size, alignof(std::max_align_t)); }
void *operator new[](std::size_t size) { return operator new(size); }
void *operator new(std::size_t size, std::align_val_t alignment) {
    return counted(size == 0 ? 1 : size, static_cast<std::size_t>(alignment));
}
void *operator new[](std::size_t size, std::align_val_t alignment) { return operator new(size, alignment); }
void operator delete(void *p) noexcept { std::free(p); }
void operator delete[](void *p) noexcept { std::free(p); }
void operator delete(void *p, std::size_t) noexcept { std::free(p); }
void operator delete[](void *p, std::size_t) noexcept { std::free(p); }
void operator delete(void *p, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void *p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void *p, std::size_t, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void *p, std::size_t, std::align_val_t) noexcept { std::free(p); }

namespace adrl {

TEST_CASE("the counter counts") {
    const long before = allocations.load();
    delete new int(1);
    CHECK(allocations.load() > before);
}

TEST_CASE("nothing is allocated after construction") {
    for (const bool polygon : {false, true}) {
        for (const int threads : {1, 2, 3}) {
            CAPTURE(polygon);
            CAPTURE(threads);
            SimFixture fixture(24, threads, polygon);
            fixture.run(3); // warm-up: threads start
            const long before = allocations.load();
            fixture.run(20);
            CHECK(allocations.load() == before);
        }
    }
}

} // namespace adrl
