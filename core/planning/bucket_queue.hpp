// A priority queue for whole-number keys that never fall: Dial's buckets, used in a circle.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace adrl {

struct QueuedNode {
    std::uint32_t key;  // its bucket
    std::uint32_t cost; // at which the node was pushed; a cheaper way found later makes the entry stale
    std::uint32_t node;
};

class BucketQueue {
  public:
    // Keys pushed lie less than `span` above the least one queued. span is a power of two.
    BucketQueue(std::uint32_t span, std::size_t capacity) : head_(span, kNone), mask_(span - 1) {
        entries_.reserve(capacity);
    }

    void clear(std::uint32_t least_key) {
        if (live_ > 0) std::fill(head_.begin(), head_.end(), kNone);
        entries_.clear();
        free_ = kNone;
        live_ = 0;
        at_ = least_key;
    }

    void push(QueuedNode item) {
        std::int32_t slot = free_;
        if (slot == kNone) {
            slot = static_cast<std::int32_t>(entries_.size());
            entries_.push_back({item, kNone});
        } else {
            free_ = entries_[slot].next;
            entries_[slot].item = item;
        }
        std::int32_t &head = head_[item.key & mask_];
        entries_[slot].next = head;
        head = slot;
        ++live_;
    }

    // The least key's newest entry. False when the queue is empty.
    bool pop(QueuedNode &item) {
        if (live_ == 0) return false;
        while (head_[at_ & mask_] == kNone) ++at_;
        const std::int32_t slot = head_[at_ & mask_];
        item = entries_[slot].item;
        head_[at_ & mask_] = entries_[slot].next;
        entries_[slot].next = free_;
        free_ = slot;
        --live_;
        return true;
    }

  private:
    static constexpr std::int32_t kNone = -1;
    struct Entry {
        QueuedNode item;
        std::int32_t next;
    };
    std::vector<Entry> entries_; // grows only beyond the capacity given
    std::vector<std::int32_t> head_;
    std::uint32_t mask_;
    std::uint32_t at_ = 0;
    std::int32_t free_ = kNone;
    std::size_t live_ = 0;
};

} // namespace adrl
