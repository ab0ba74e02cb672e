// Linked where a wheel is built on a system newer than the oldest it is for: what glibc 2.28 and the libstdc++ of its
// day lack, and compilers of today ask for. Functions that have changed are called by their versions of then, which
// CMakeLists.txt names to the linker (--wrap); what did not exist yet is here.
#include <new>

#if !defined(__GLIBC__) || !defined(__GLIBCXX__) || !defined(__x86_64__)
#error "ADRL_GLIBC_2_28 is for x86-64 with glibc and libstdc++"
#endif

#define ADRL_VERSION_OF_THEN(name, symbol) __asm__(".symver " #name ", " symbol)
#define ADRL_HERE __attribute__((visibility("hidden")))

extern "C" {

// The later versions only leave errno alone, which nothing reads.
ADRL_VERSION_OF_THEN(exp_then, "exp@GLIBC_2.2.5");
double exp_then(double x);
ADRL_HERE double __wrap_exp(double x) { return exp_then(x); }

ADRL_VERSION_OF_THEN(hypot_then, "hypot@GLIBC_2.2.5");
double hypot_then(double x, double y);
ADRL_HERE double __wrap_hypot(double x, double y) { return hypot_then(x, y); }

// std::condition_variable::wait
ADRL_VERSION_OF_THEN(wait_then, "_ZNSt18condition_variable4waitERSt11unique_lockISt5mutexE@GLIBCXX_3.4.11");
void wait_then(void *condition, void *lock);
ADRL_HERE void __wrap__ZNSt18condition_variable4waitERSt11unique_lockISt5mutexE(void *condition, void *lock) {
    wait_then(condition, lock);
}

// std::exception_ptr counted its references in its copy constructor and destructor then, which were no inline
// functions. A copy that is never destroyed is one reference more.
ADRL_VERSION_OF_THEN(copy_then, "_ZNSt15__exception_ptr13exception_ptrC1ERKS0_@CXXABI_1.3.3");
void copy_then(void *copy, const void *pointer);
ADRL_HERE void addref(void *pointer) __asm__("_ZNSt15__exception_ptr13exception_ptr9_M_addrefEv");
void addref(void *pointer) {
    void *copy;
    copy_then(&copy, pointer);
}

ADRL_VERSION_OF_THEN(destroy_then, "_ZNSt15__exception_ptr13exception_ptrD1Ev@CXXABI_1.3.3");
void destroy_then(void *pointer);
ADRL_HERE void release(void *pointer) __asm__("_ZNSt15__exception_ptr13exception_ptr10_M_releaseEv");
void release(void *pointer) { destroy_then(pointer); }

// Whether shared pointers may count without atomics: never.
ADRL_HERE char __libc_single_threaded = 0;
}

namespace std {
[[noreturn]] ADRL_HERE void __throw_bad_array_new_length() { throw bad_array_new_length(); }
} // namespace std
