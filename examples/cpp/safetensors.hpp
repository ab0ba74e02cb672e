// Reads the safetensors files that `adrl export RUN --safetensors` writes: arrays of float, double and int32.
#pragma once

#include <bit>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <stdexcept>
#include <string>
#include <system_error>
#include <type_traits>
#include <vector>

static_assert(std::endian::native == std::endian::little, "safetensors are little-endian");

class Safetensors {
  public:
    // Throws std::runtime_error, naming the file, for one that is missing or malformed.
    explicit Safetensors(const std::string &path) : path_(path) {
        std::error_code none;
        if (!std::filesystem::is_regular_file(path, none)) fail("no such file, or not an ordinary one");
        const std::uintmax_t size = std::filesystem::file_size(path, none);
        std::ifstream file(path, std::ios::binary);
        std::uint64_t length = 0;
        file.read(reinterpret_cast<char *>(&length), sizeof length);
        if (!file || size > (1U << 30) || length > size - sizeof length) fail("not a safetensors file");
        std::string header(length, ' ');
        file.read(header.data(), static_cast<std::streamsize>(length));
        data_.resize(size - sizeof length - length);
        file.read(data_.data(), static_cast<std::streamsize>(data_.size()));
        if (!file) fail("cannot be read to its end");
        parse(header);
    }

    bool has(const std::string &name) const { return entries_.contains(name); }

    template <class T>
    std::vector<T> read(const std::string &name) const {
        const Entry &e = entry(name);
        const std::string dtype = std::is_same_v<T, float> ? "F32" : std::is_same_v<T, double> ? "F64" : "I32";
        if (e.dtype != dtype || e.end > data_.size() || e.begin > e.end || (e.end - e.begin) % sizeof(T) != 0) {
            fail("tensor " + name + " is truncated or not " + dtype);
        }
        std::vector<T> values((e.end - e.begin) / sizeof(T));
        std::size_t left = values.size();
        for (const std::size_t n : e.shape) {
            if (n == 0 || left % n != 0) fail("tensor " + name + " is empty or does not have its shape");
            left /= n;
        }
        if (left != 1) fail("tensor " + name + " is empty or does not have its shape");
        std::memcpy(values.data(), data_.data() + e.begin, e.end - e.begin);
        return values;
    }

    // Throws std::runtime_error that names the file.
    [[noreturn]] void fail(const std::string &why) const { throw std::runtime_error(path_ + ": " + why); }

  private:
    struct Entry {
        std::string dtype;
        std::vector<std::size_t> shape;
        std::size_t begin = 0, end = 0;
    };

    const Entry &entry(const std::string &name) const {
        const auto found = entries_.find(name);
        if (found == entries_.end()) fail("no tensor " + name);
        return found->second;
    }

    // The header is one object: {"__metadata__": {name: text, ...}, name: {"dtype": "F32", "shape": [..],
    // "data_offsets": [begin, end]}, ...}. Entries are found by what only they have; texts are skipped over.
    void parse(const std::string &text) {
        std::size_t at = 0;
        const auto skip = [&] {
            while (at < text.size() &&
                   (std::isspace(static_cast<unsigned char>(text[at])) || text[at] == ':' || text[at] == ','))
                ++at;
        };
        const auto expect = [&](char c) {
            skip();
            if (at >= text.size() || text[at++] != c) fail("malformed header");
        };
        const auto quoted = [&] {
            expect('"');
            std::string out;
            while (at < text.size() && text[at] != '"') {
                if (text[at] == '\\') ++at;
                if (at < text.size()) out += text[at++];
            }
            expect('"');
            return out;
        };
        const auto closes = [&](char c) {
            skip();
            if (at >= text.size()) fail("malformed header");
            if (text[at] != c) return false;
            ++at;
            return true;
        };
        const auto numbers = [&] {
            std::vector<std::size_t> out;
            expect('[');
            while (!closes(']')) {
                std::size_t number = 0;
                const auto [end, error] = std::from_chars(text.data() + at, text.data() + text.size(), number);
                if (error != std::errc()) fail("malformed header: a size is no number that fits");
                out.push_back(number);
                at = static_cast<std::size_t>(end - text.data());
            }
            return out;
        };
        expect('{');
        while (!closes('}')) {
            const std::string name = quoted();
            expect('{');
            Entry e;
            while (!closes('}')) {
                const std::string key = quoted();
                if (key == "shape" && name != "__metadata__") {
                    e.shape = numbers();
                } else if (key == "data_offsets" && name != "__metadata__") {
                    const auto ends = numbers();
                    if (ends.size() != 2) fail("malformed header");
                    e.begin = ends[0];
                    e.end = ends[1];
                } else {
                    skip();
                    const std::string value = quoted();
                    if (key == "dtype") e.dtype = value;
                }
            }
            if (name != "__metadata__") entries_[name] = e;
        }
    }

    std::string path_;
    std::string data_;
    std::map<std::string, Entry> entries_;
};
