// Scratch that threads borrow: as many pieces as threads, so that there always is one.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

namespace adrl {

template <class T>
class Stock {
  public:
    class Borrowed { // put back at its end
      public:
        explicit Borrowed(Stock &owner) : owner_(owner) {
            const std::scoped_lock lock(owner.mutex_);
            piece_ = std::move(owner.pieces_.back());
            owner.pieces_.pop_back();
        }
        ~Borrowed() {
            const std::scoped_lock lock(owner_.mutex_);
            owner_.pieces_.push_back(std::move(piece_));
        }
        Borrowed(const Borrowed &) = delete;
        Borrowed &operator=(const Borrowed &) = delete;
        T &operator*() { return *piece_; }
        T *operator->() { return piece_.get(); }

      private:
        Stock &owner_;
        std::unique_ptr<T> piece_;
    };

    void add(std::unique_ptr<T> piece) { pieces_.push_back(std::move(piece)); }
    Borrowed borrow() { return Borrowed(*this); }

  private:
    std::mutex mutex_;
    std::vector<std::unique_ptr<T>> pieces_;
};

} // namespace adrl
