#include "thread_pool.hpp"

#include <algorithm>

#ifdef __linux__
#include <sched.h>
#endif

namespace adrl {
namespace {

int usable_cores() {
#ifdef __linux__
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) == 0) return std::max(1, CPU_COUNT(&set));
#endif
    return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

} // namespace

ThreadPool::ThreadPool(int num_threads) {
    const int total = num_threads > 0 ? num_threads : usable_cores();
    for (int i = 1; i < total; ++i) {
        workers_.emplace_back([this] { serve(); });
    }
}

ThreadPool::~ThreadPool() {
    {
        const std::scoped_lock lock(mutex_);
        ends_ = true;
    }
    wake_.notify_all();
    for (std::thread &worker : workers_) worker.join();
}

void ThreadPool::share_out(int count, const std::function<void(int, int)> &work) {
    if (workers_.empty() || count <= 1) {
        if (count > 0) work(0, count);
        return;
    }
    {
        const std::scoped_lock lock(mutex_);
        work_ = &work;
        count_ = count;
        // A few chunks a thread even out robots that cost more than others.
        chunk_ = std::max(1, count / (8 * size()));
        next_.store(0);
        pending_.store(static_cast<int>(workers_.size()));
        ++round_;
    }
    wake_.notify_all();
    while (take()) {
    }
    while (pending_.load() > 0) std::this_thread::yield();
}

bool ThreadPool::take() {
    const int first = next_.fetch_add(chunk_);
    if (first >= count_) return false;
    (*work_)(first, std::min(count_, first + chunk_));
    return true;
}

void ThreadPool::serve() {
    std::uint64_t seen = 0;
    while (true) {
        {
            std::unique_lock lock(mutex_);
            wake_.wait(lock, [&] { return ends_ || round_ != seen; });
            if (ends_) return;
            seen = round_;
        }
        while (take()) {
        }
        pending_.fetch_sub(1);
    }
}

} // namespace adrl
