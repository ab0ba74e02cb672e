#include "thread_pool.hpp"

#include <algorithm>

#include <sched.h>

namespace adrl {
namespace {

int usable_cores() {
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) == 0) return std::max(1, CPU_COUNT(&set));
    return std::max(1U, std::thread::hardware_concurrency());
}

} // namespace

ThreadPool::ThreadPool(int num_threads) {
    const int total = num_threads > 0 ? num_threads : usable_cores();
    for (int i = 1; i < total; ++i) {
        workers_.emplace_back([this](const std::stop_token &stop) { serve(stop); });
    }
}

ThreadPool::~ThreadPool() {
    for (std::jthread &worker : workers_) worker.request_stop();
    wake_.notify_all();
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

void ThreadPool::serve(std::stop_token stop) {
    std::uint64_t seen = 0;
    while (true) {
        {
            std::unique_lock lock(mutex_);
            if (!wake_.wait(lock, stop, [&] { return round_ != seen; })) return;
            seen = round_;
        }
        while (take()) {
        }
        pending_.fetch_sub(1);
    }
}

} // namespace adrl
