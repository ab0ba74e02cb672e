// A fixed set of threads that share out ranges of work.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace adrl {

class ThreadPool {
  public:
    // num_threads counts the caller; 0 takes one per core this process may use.
    explicit ThreadPool(int num_threads);
    ~ThreadPool();
    ThreadPool(const ThreadPool &) = delete;
    ThreadPool &operator=(const ThreadPool &) = delete;

    int size() const { return static_cast<int>(workers_.size()) + 1; }
    // Calls work(first, last) on disjoint ranges that cover [0, count), and returns when all are done. Work is called
    // by reference: whatever it captures, nothing is allocated.
    template <class Work>
    void run(int count, const Work &work) {
        share_out(count, std::cref(work));
    }

  private:
    void share_out(int count, const std::function<void(int, int)> &work);
    void serve();
    bool take();

    std::vector<std::thread> workers_;
    std::mutex mutex_;
    std::condition_variable wake_;
    bool ends_ = false;
    const std::function<void(int, int)> *work_ = nullptr;
    int count_ = 0;
    int chunk_ = 1;
    std::atomic<int> next_{0};
    std::atomic<int> pending_{0};
    std::uint64_t round_ = 0;
};

} // namespace adrl
