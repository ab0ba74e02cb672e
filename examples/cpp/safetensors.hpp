// Reads the safetensors files that `adrl export RUN --safetensors` writes: arrays of float, double and int32.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

static_assert(std::endian::native == std::endian::little, "safetensors are little-endian");

class Safetensors {
  public:
    // Throws std::runtime_error, naming the file, for one that is missing or malformed.
    explicit Safetensors(const std::string &path) : path_(path) {
        std::ifstream file(path, std::ios::binary);
        std::uint64_t length = 0;
        file.read(reinterpret_cast<char *>(&length), sizeof length);
        if (!file || length > (1U << 20)) fail("not a safetensors file");
        std::string header(length, ' ');
        file.read(header.data(), static_cast<std::streamsize>(length));
        std::ostringstream rest;
        rest << file.rdbuf();
        data_ = rest.str();
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
        std::memcpy(values.data(), data_.data() + e.begin, e.end - e.begin);
        std::size_t wanted = 1;
        for (const std::size_t n : e.shape) wanted *= n;
        if (wanted != values.size()) fail("tensor " + name + " does not have its shape");
        return values;
    }

  private:
    struct Entry {
        std::string dtype;
        std::vector<std::size_t> shape;
        std::size_t begin = 0, end = 0;
    };

    [[noreturn]] void fail(const std::string &why) const { throw std::runtime_error(path_ + ": " + why); }

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
            ++at;
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
                std::size_t used = 0;
                out.push_back(std::stoull(text.substr(at, 20), &used));
                at += used;
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
